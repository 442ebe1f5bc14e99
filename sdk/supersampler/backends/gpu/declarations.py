"""The declarations of a WGSL file, and those of a shader that its entry point needs."""

import re
from collections.abc import Iterable
from typing import NamedTuple

_NAME = re.compile(r"(?:@\w+(?:\([^)]*\))?\s*)*(?:fn|struct|alias|const|override|var(?:<[^>]*>)?)\s+(\w+)")
_COMMENT = re.compile(r"//[^\n]*")
_WORD = re.compile(r"(?<![\w.])[A-Za-z_]\w*")
_LOCAL = re.compile(r"\b(?:let|var|const)\s+(\w+)")
_PARAMETER = re.compile(r"(\w+)\s*:")


class Declaration(NamedTuple):
    """A function, structure, constant or variable of a module.

    Attributes:
        name: its name.
        text: its code, with comments before it and at the end of its line.
        words: names of others that it may use.
    """

    name: str
    text: str
    words: frozenset[str]


class Part(NamedTuple):
    """A file: its first comment, and its declarations."""

    header: str
    declarations: list[Declaration]


def parsed(source: str) -> Part:
    """Return the declarations of a file.

    Comments belong to the declaration after them; the first comment, before an empty line, to the file.
    """
    header, blank, rest = source.partition("\n\n")
    if not blank or _COMMENT.sub("", header).strip():
        header, rest = "", source
    found = []
    while rest.strip():
        end = _end(rest)
        found.append(_declaration(rest[:end].strip()))
        rest = rest[end:]
    return Part(header.strip(), found)


def needed(parts: Iterable[Part], entry: str = "main") -> str:
    """Return the code of what `entry` needs, in order, with the headers of the files.

    Raises:
        KeyError: nothing is called `entry`.
    """
    parts = list(parts)
    known = {one.name: one for part in parts for one in part.declarations}
    reached, waiting = set[str](), [known[entry].name]
    while waiting:
        name = waiting.pop()
        if name not in reached:
            reached.add(name)
            waiting += known[name].words & known.keys()
    kept = [Part(p.header, [one for one in p.declarations if one.name in reached]) for p in parts]
    return "\n".join(_text(part) for part in kept if part.declarations)


def _text(part: Part) -> str:
    """Return the code of a file: lines close up where both declarations are of one line."""
    text = f"{part.header}\n\n" if part.header else ""
    for index, one in enumerate(part.declarations):
        before = part.declarations[index - 1].text if index else one.text
        text += ("\n" if "\n" in before + one.text and index else "") + one.text + "\n"
    return text


def _end(source: str) -> int:
    """Return where the first declaration of a source ends, the comment on its last line included."""
    code = _COMMENT.sub(lambda comment: " " * len(comment[0]), source)
    depth = 0
    for at, letter in enumerate(code):
        depth += (letter in "([{") - (letter in ")]}")
        if depth == 0 and letter in ";}":
            line = source.find("\n", at)
            end = len(source) if line < 0 else line
            return end if not code[at + 1 : end].strip() else at + 1
    raise ValueError(f"no declaration: {source[:60]!r}")


def _declaration(text: str) -> Declaration:
    code = _COMMENT.sub("", text).strip()
    name = _NAME.match(code)
    if name is None:
        raise ValueError(f"no declaration: {text[:60]!r}")
    words = set(_WORD.findall(code)) - {name[1]}
    if "{" in code:
        head, _, body = code.partition("{")
        own = _LOCAL.findall(body) + _PARAMETER.findall(head if "fn " in head else body)
        words -= set(own)
    return Declaration(name[1], text, frozenset(words))
