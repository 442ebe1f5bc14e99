"""One table for people: on the terminal, and between two marks of a Markdown file."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from rich.table import Table

from supersampler.errors import ArgumentError
from supersampler.files import replacing
from supersampler.shot import Shot
from supersampler_bench.quality import BORDER, ORACLE, WARM_UP_FRAMES, MeanScores, MethodScores

Summaries: TypeAlias = Sequence[MethodScores | MeanScores]


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


def cells(results: Summaries, bold: str) -> list[list[str]]:
    """Return one row a method: its name and its figures, the best of each column within `bold` marks.

    Args:
        results: the summaries without warm-up and border are shown.
        bold: such as "**{}**".
    """
    columns = [_column(column, results, bold) for column in COLUMNS]
    return [
        [result.method, *figures] for result, figures in zip(results, zip(*columns, strict=True), strict=True)
    ]


def _column(column: Column, results: Summaries, bold: str) -> list[str]:
    values = [result.summary()[column.metric] * column.scale for result in results]
    figures = ["–" if math.isnan(value) else f"{value:.{column.digits}f}" for value in values]
    known = [  # as shown: equal figures are equally good
        float(f) for f, r in zip(figures, results, strict=True) if f != "–" and r.method != ORACLE
    ]
    best = (max if column.higher_is_better else min)(known, default=None)
    best_ones = [
        f != "–" and float(f) == best and r.method != ORACLE for f, r in zip(figures, results, strict=True)
    ]
    return [bold.format(f) if good else f for f, good in zip(figures, best_ones, strict=True)]


def caption(shot: Shot, results: Sequence[MethodScores]) -> str:
    """Say in one line what was measured."""
    width, height = shot.render_size
    large_width, large_height = shot.display_size or (0, 0)
    scored = sum(frame.frame >= WARM_UP_FRAMES for frame in results[0].frames)
    return (
        f"{shot.name}, {width}x{height} to {large_width}x{large_height}: {scored} reference frames of "
        f"{len(shot)}, without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"
    )


def mean_caption(shots: Sequence[Shot], ratio: float) -> str:
    """Say in one line of which shots a table shows the mean."""
    large_width, large_height = shots[0].display_size or (0, 0)
    names = ", ".join(shot.name for shot in shots)
    return (
        f"Mean of the shots {names} at ratio {ratio:g} to {large_width}x{large_height}: {len(shots[0])} "
        f"frames each, without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"
    )


def rich_table(title: str, results: Summaries) -> Table:
    """Return the table for a terminal: a line a metric, so that it fits into 80 columns."""
    table = Table("", caption=title)
    for result in results:
        table.add_column(result.method, justify="right")
    for column in COLUMNS:
        table.add_row(column.heading, *_column(column, results, "[bold]{}[/bold]"))
    return table


def markdown_table(title: str, results: Summaries) -> str:
    """Return the table as Markdown, with its caption."""
    heading = ["method", *(column.heading for column in COLUMNS)]
    rows = [heading, ["---", *(["---:"] * len(COLUMNS))], *cells(results, "**{}**")]
    lines = [*("| " + " | ".join(row) + " |" for row in rows), "", f"{title}.", *coverage(results)]
    return "\n".join(lines)


def coverage(results: Summaries) -> list[str]:
    """Say how much of the way in PSNR from `taau` to the oracle each better method goes."""
    psnr = {result.method: result.summary()["psnr"] for result in results}
    if not {"taau", ORACLE} <= set(psnr):
        return []
    start, way = psnr["taau"], psnr[ORACLE] - psnr["taau"]
    covered = {name: (value - start) / way for name, value in psnr.items() if start < value < psnr[ORACLE]}
    return [
        f"Of the way from taau to the oracle, {name} goes {share:.0%}." for name, share in covered.items()
    ]


def update_block(path: Path, name: str, text: str) -> None:
    """Replace what stands between `<!-- bench:NAME -->` and `<!-- /bench -->`, whole or not at all.

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
        with path.open(encoding="utf-8", newline="") as file:  # line ends stay as they are
            content = file.read()
    except OSError as error:
        raise ArgumentError("update", got=f"{path} ({error})", want="a Markdown file") from error
    found = re.findall(re.escape(opening) + r".*?" + re.escape(closing), content, re.DOTALL)
    if len(found) != 1:
        hint = f"Write the lines {opening} and {closing} where the table should stand."
        raise ArgumentError(
            "update", got=f"{path} with {len(found)} blocks of {name!r}", want="one", hint=hint
        )
    start = content.index(found[0]) + len(opening)
    return content, start, start + len(found[0]) - len(opening) - len(closing)
