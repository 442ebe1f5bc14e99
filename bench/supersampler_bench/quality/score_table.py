"""Tables of quality scores, for the terminal and as Markdown."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rich.table import Table

from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES, Summarized

Summaries: TypeAlias = Sequence[Summarized]
ShotFacts: TypeAlias = Mapping[str, Any]
"""What a record says of a shot."""


@dataclass(frozen=True)
class Column:
    """How one metric is shown: times `scale`, with so many digits after the point."""

    metric: str
    heading: str
    digits: int
    higher_is_better: bool
    scale: float = 1.0


COLUMNS = (
    Column("psnr", "PSNR dB ↑", 2, True),
    Column("ssim", "SSIM ↑", 4, True),
    Column("flip", "FLIP ↓", 4, False),
    Column("tpsnr", "tPSNR dB ↑", 2, True),
    Column("warped_error_difference", "warped error 1e-3 ↓", 2, False, 1000.0),
    Column("psnr_disoccluded", "PSNR dB, disoccluded ↑", 2, True),
    Column("psnr_changing_light", "PSNR dB, changing light ↑", 2, True),
    Column("psnr_aliased", "PSNR dB, aliased ↑", 2, True),
    Column("psnr_moving", "PSNR dB, moving ↑", 2, True),
)
"""Of the first table, which README shows."""

CLIP_COLUMNS = (
    *(column for column in COLUMNS if not column.metric.startswith("psnr_")),
    Column("strred", "STRRED ↓", 1, False),
)
"""Of the second one: what concerns all pixels, with the metrics of whole clips."""


def cells(
    results: Summaries, bold: str, columns: Sequence[Column] = COLUMNS, *, everything: bool = False
) -> list[list[str]]:
    """Return one row a method: its name and its figures, the best of each column within `bold` marks.

    Args:
        results: whose summaries are shown.
        bold: such as "**{}**".
        columns: in order.
        everything: count the first frames and the border, too.
    """
    shown = [_column(column, results, bold, everything) for column in columns]
    return [
        [result.method, *figures] for result, figures in zip(results, zip(*shown, strict=True), strict=True)
    ]


def _column(column: Column, results: Summaries, bold: str, everything: bool = False) -> list[str]:
    values = [_value(column.metric, result, everything) * column.scale for result in results]
    figures = ["–" if math.isnan(value) else f"{value:.{column.digits}f}" for value in values]
    known = [float(f) for f in figures if f != "–"]  # as shown: equal figures are equally good
    best = (max if column.higher_is_better else min)(known, default=None)
    return [bold.format(f) if f != "–" and float(f) == best else f for f in figures]


def _value(metric: str, result: Summarized, everything: bool) -> float:
    return result.summary(warm=not everything, cropped=not everything)[metric]


def caption(shot: ShotFacts, *, everything: bool = False) -> str:
    """Say in one line what was measured."""
    scored = sum(frame >= WARM_UP_FRAMES or everything for frame in shot["reference_frames"])
    return f"{sizes(shot)}: {scored} reference frames of {shot['frames']}, {_counted(everything)}"


def sizes(shot: ShotFacts) -> str:
    """Return the name of a shot with references and its sizes."""
    (width, height), (large_width, large_height) = shot["render_size"], shot["display_size"]
    return f"{shot['name']}, {width}x{height} to {large_width}x{large_height}"


def mean_caption(shots: Sequence[ShotFacts], ratio: float, *, everything: bool = False) -> str:
    """Say in one line of which shots a table shows the mean."""
    large_width, large_height = shots[0]["display_size"]
    names = ", ".join(shot["name"] for shot in shots)
    return (
        f"Mean of the shots {names} at ratio {ratio:g} to {large_width}x{large_height}: "
        f"{shots[0]['frames']} frames each, {_counted(everything)}"
    )


def _counted(everything: bool) -> str:
    if everything:
        return "from the first frame and to the border"
    return f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"


def rich_table(title: str, results: Summaries) -> Table:
    """Return the table for a terminal: a line a metric, so that it fits into 80 columns."""
    table = Table("", caption=title)
    for result in results:
        table.add_column(result.method, justify="right")
    for column in dict.fromkeys((*COLUMNS, *CLIP_COLUMNS)):
        table.add_row(column.heading, *_column(column, results, "[bold]{}[/bold]"))
    return table


def markdown_table(
    title: str, results: Summaries, columns: Sequence[Column] = COLUMNS, *, everything: bool = False
) -> str:
    """Return the table as Markdown, with its caption."""
    heading = ["method", *(column.heading for column in columns)]
    figures = cells(results, "**{}**", columns, everything=everything)
    rows = [heading, ["---", *(["---:"] * len(columns))], *figures]
    return "\n".join([*("| " + " | ".join(row) + " |" for row in rows), "", f"{title}."])
