"""Bytes, multiply-adds and dispatches of a step: counted, the same on every machine.

Each backend has a module with a function from (method, render size, display size) to a `Traffic`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from supersampler.frame import Size
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record


@dataclass(frozen=True)
class Traffic:
    """Cost of one step of a method on a backend.

    Attributes:
        backend: its name.
        method: the model's name.
        bytes: read and written by all dispatches.
        multiply_adds: of convolutions and matrix products.
        dispatches: operators of a graph, or shaders.
    """

    backend: str
    method: str
    bytes: int
    multiply_adds: int
    dispatches: int


def traffic_record(sizes: Sequence[tuple[Size, Size, Sequence[Traffic]]]) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        sizes: (render size, display size, counts) of each pair of sizes.
    """
    counted = [
        {"render": list(render), "display": list(display), "steps": [asdict(row) for row in rows]}
        for render, display, rows in sizes
    ]
    return {"bench": "traffic", "sizes": counted}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [
        [
            f"{size_text(size['render'])} to {size_text(size['display'])}",
            row["method"],
            row["backend"],
            f"{row['bytes'] / 1e9:.2f}",
            f"{row['multiply_adds'] / 1e9:.1f}",
            row["dispatches"],
        ]
        for size in record["sizes"]
        for row in size["steps"]
    ]
    headings = ["size", "method", "backend", "GB moved:", "10^9 multiply-adds:", "dispatches:"]
    caption = (
        "One step. Moved are the inputs and outputs of every dispatch; multiply-adds are those of "
        "convolutions and matrix products."
    )
    return table(headings, rows, caption)
