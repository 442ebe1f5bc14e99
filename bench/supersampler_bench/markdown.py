"""Markdown of the documentation: tables, numbers, and generated blocks of files."""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from supersampler.errors import ArgumentError
from supersampler.io.files import replacing


def table(headings: Sequence[str], rows: Iterable[Iterable[object]], caption: str = "") -> str:
    """Return a Markdown table with its caption below.

    Args:
        headings: headings of the columns; one that ends with ":" is aligned to the right, as numbers are.
        rows: cells of each row.
        caption: a paragraph; "" for none.
    """
    rule = ["---:" if heading.endswith(":") else "---" for heading in headings]
    lines = [[heading.removesuffix(":") for heading in headings], rule, *rows]
    text = "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)
    return f"{text}\n\n{caption}" if caption else text


def figure(value: float | None, digits: int, unit: str = "") -> str:
    """Return a number with so many digits after the point; a dash where it is not known."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}f}{unit}"


def update_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- bench:NAME -->` and `<!-- /bench -->`, atomically.

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
