"""Markdown of the documentation: tables, numbers, and generated blocks of files."""

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.files import replacing


def table(headings: Sequence[str], rows: Iterable[Iterable[object]], caption: str = "") -> str:
    """Return a Markdown table with its caption below; a heading that ends with ":" is aligned right."""
    rule = ["---:" if heading.endswith(":") else "---" for heading in headings]
    lines = [[heading.removesuffix(":") for heading in headings], rule, *rows]
    text = "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)
    return f"{text}\n\n{caption}" if caption else text


def figure(value: float | None, digits: int, unit: str = "") -> str:
    """Return a number with `digits` decimals; a dash for None or NaN."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}f}{unit}"


def sizes_text(render: Size, display: Size) -> str:
    """Return "960x540 to 1920x1080"."""
    return f"{size_text(render)} to {size_text(display)}"


def update_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- bench:NAME -->` and `<!-- /bench -->`, atomically; see `find_block`."""
    content, start, stop = find_block(path, name)
    end = "\r\n" if "\r\n" in content else "\n"
    inner = end.join(["", *text.split("\n"), ""])
    with replacing(path) as partial:
        partial.write_text(content[:start] + inner + content[stop:], encoding="utf-8", newline="")


def find_block(path: Path, name: str) -> tuple[str, int, int]:
    """Return the text of a Markdown file, and the start and end of the block `name` in it.

    Raises:
        ArgumentError: the file cannot be read, or does not have exactly one such block.
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
