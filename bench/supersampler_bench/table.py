"""One table for people: on the terminal, and between two marks of a Markdown file."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from rich.table import Table

from supersampler.errors import ArgumentError
from supersampler.io.atomic import replacing
from supersampler_bench.quality import ORACLE
from supersampler_bench.scores import BORDER, WARM_UP_FRAMES, Summarised

Summaries: TypeAlias = Sequence[Summarised]
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
    Column("cvvdp", "ColorVideoVDP JOD ↑", 3, True),
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
    known = [  # as shown: equal figures are equally good
        float(f) for f, r in zip(figures, results, strict=True) if f != "–" and r.method != ORACLE
    ]
    best = (max if column.higher_is_better else min)(known, default=None)
    best_ones = [
        f != "–" and float(f) == best and r.method != ORACLE for f, r in zip(figures, results, strict=True)
    ]
    return [bold.format(f) if good else f for f, good in zip(figures, best_ones, strict=True)]


def _value(metric: str, result: Summarised, everything: bool) -> float:
    return result.summary(warm=not everything, cropped=not everything)[metric]


def _measured(columns: Sequence[Column], results: Summaries) -> list[Column]:
    """Leave out ColorVideoVDP where it was not asked for."""
    return [
        column
        for column in columns
        if column.metric != "cvvdp" or any(not math.isnan(_value("cvvdp", r, False)) for r in results)
    ]


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
    for column in _measured(list(dict.fromkeys((*COLUMNS, *CLIP_COLUMNS))), results):
        table.add_row(column.heading, *_column(column, results, "[bold]{}[/bold]"))
    return table


def markdown_table(
    title: str, results: Summaries, columns: Sequence[Column] = COLUMNS, *, everything: bool = False
) -> str:
    """Return the table as Markdown, with its caption."""
    columns = _measured(columns, results)
    heading = ["method", *(column.heading for column in columns)]
    figures = cells(results, "**{}**", columns, everything=everything)
    rows = [heading, ["---", *(["---:"] * len(columns))], *figures]
    return "\n".join([*("| " + " | ".join(row) + " |" for row in rows), "", f"{title}."])


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


def update_blocks(path: Path, texts: Mapping[str, str]) -> None:
    """Replace each of the named blocks that a Markdown file has; see `update_block`."""
    for name in find_blocks(path, list(texts)):
        update_block(path, name, texts[name])


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
