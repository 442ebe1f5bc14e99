"""Find and replace generated text in Markdown files, between `<!-- bench:NAME -->` and `<!-- /bench -->`."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from supersampler.errors import ArgumentError
from supersampler.io.files import replacing


def find_blocks(path: Path, names: Sequence[str]) -> list[str]:
    """Return those of the blocks `names` that a Markdown file has.

    Raises:
        ArgumentError: it has none of them, or one twice, or cannot be read.
    """
    content = path.read_text(encoding="utf-8") if path.is_file() else ""
    found = [name for name in names if f"<!-- bench:{name} -->" in content]
    for name in found or names[:1]:
        find_block(path, name)
    return found


def update_blocks(path: Path, texts: Mapping[str, str]) -> None:
    """Replace each of the named blocks that a Markdown file has; see `update_block`."""
    for name in find_blocks(path, list(texts)):
        update_block(path, name, texts[name])


def update_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- bench:NAME -->` and `<!-- /bench -->`, whole or not at all.

    Raises:
        ArgumentError: see `find_block`.
        ShotError: the file cannot be written.
    """
    content, start, stop = find_block(path, name)
    end = "\r\n" if "\r\n" in content else "\n"
    inner = end.join(["", *text.split("\n"), ""])
    with replacing(path) as partial:
        partial.write_text(content[:start] + inner + content[stop:], encoding="utf-8", newline="")


def find_block(path: Path, name: str) -> tuple[str, int, int]:
    """Return a Markdown file's text, and where in it the block `name` (as "quality plaza") begins and ends.

    Raises:
        ArgumentError: the file cannot be read, or has not exactly one such block.
    """
    opening, closing = f"<!-- bench:{name} -->", "<!-- /bench -->"
    try:
        with path.open(encoding="utf-8", newline="") as file:  # newline="": line ends stay as they are
            content = file.read()
    except OSError as error:
        raise ArgumentError("update", got=f"{path} ({error})", want="a Markdown file") from error
    found = list(re.finditer(f"(?<={re.escape(opening)}).*?(?={re.escape(closing)})", content, re.DOTALL))
    if len(found) != 1:
        got = f"{path} with {len(found)} blocks of {name!r}"
        hint = f"Write the lines {opening} and {closing} where the table should stand."
        raise ArgumentError("update", got=got, want="one", hint=hint)
    return content, *found[0].span()
