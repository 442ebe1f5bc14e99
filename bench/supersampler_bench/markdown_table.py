"""Format Markdown tables, numbers and sizes for the documentation."""

import math
from collections.abc import Iterable, Sequence

from supersampler.frame import Size


def table(headings: Sequence[str], rows: Iterable[Iterable[object]], caption: str = "") -> str:
    """Return a Markdown table with its caption below.

    Args:
        headings: of the columns; one that ends with ":" is aligned to the right, as numbers are.
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


def size_text(size: Size | Sequence[int]) -> str:
    """Return (width, height) as "960x540"."""
    return f"{size[0]}x{size[1]}"
