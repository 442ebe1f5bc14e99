"""Tables of quality records, for the terminal and as blocks of Markdown files."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from rich.table import Table

from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.quality.confusion import class_tables
from supersampler_bench.quality.score_record import shots_by_ratio
from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES
from supersampler_bench.record import Record

Rows: TypeAlias = Sequence[Record]
"""Summaries of methods: a record's `means` at one ratio, or the `methods` of a shot."""
Titled: TypeAlias = tuple[str, Rows]
NO_CLASSES = "No method predicts classes, or the shots have no true classes."


@dataclass(frozen=True)
class Column:
    """How one metric is shown.

    Attributes:
        name: of the metric, in a record.
        title: for people.
        digits: after the point.
        higher: whether more is better.
        scale: factor on the value.
        rare: whether tables omit the column where no method has a value.
    """

    name: str
    title: str
    digits: int
    higher: bool = True
    scale: float = 1.0
    rare: bool = False

    @property
    def heading(self) -> str:
        """Title with an arrow to the better side."""
        return f"{self.title} {'↑' if self.higher else '↓'}"

    def figure(self, scores: Mapping[str, float | None]) -> str:
        """Return the metric of some scores as text; a dash where it is unknown."""
        value = scores.get(self.name)
        return figure(None if value is None else value * self.scale, self.digits)


COLUMNS = (
    Column("psnr", "PSNR dB", 2),
    Column("ssim", "SSIM", 4),
    Column("flip", "FLIP", 4, higher=False),
    Column("tpsnr", "tPSNR dB", 2),
    Column("warped_error_difference", "warped error 1e-3", 2, higher=False, scale=1000.0),
    Column("psnr_disoccluded", "PSNR dB, disoccluded", 2),
    Column("psnr_changing_light", "PSNR dB, changing light", 2),
    Column("psnr_aliased", "PSNR dB, aliased", 2),
    Column("psnr_thin", "PSNR dB, thin", 2, rare=True),
    Column("psnr_moving", "PSNR dB, moving", 2),
)
"""Of the first table, which README shows."""

CLIP_COLUMNS = (*COLUMNS[:5], Column("strred", "STRRED", 1, higher=False))
"""Of the second table: metrics of all pixels, and those of whole clips."""


def markdown_table(
    title: str, rows: Rows, columns: Sequence[Column] = COLUMNS, *, everything: bool = False
) -> str:
    """Return a table as Markdown; the best figure of each column is bold.

    Args:
        title: the caption without its full stop.
        rows: one for each method.
        columns: in order; rare ones are omitted where no row has a value.
        everything: count the first frames and the border, too.
    """
    shown = _shown(columns, rows)
    cells = zip(*(_column(column, rows, "**{}**", everything) for column in shown), strict=True)
    headings = ["method", *(f"{column.heading}:" for column in shown)]
    named = ([row["method"], *figures] for row, figures in zip(rows, cells, strict=True))
    return table(headings, named, f"{title}.")


def rich_table(title: str, rows: Rows) -> Table:
    """Return the table for a terminal: a line a metric, so that it fits into 80 columns."""
    shown = Table("", caption=title)
    for row in rows:
        shown.add_column(row["method"], justify="right")
    for column in _shown(dict.fromkeys((*COLUMNS, *CLIP_COLUMNS)), rows):
        shown.add_row(column.heading, *_column(column, rows, "[bold]{}[/bold]"))
    return shown


def _shown(columns: Iterable[Column], rows: Rows) -> list[Column]:
    """Return the columns, without rare ones in which no row has a value."""
    return [c for c in columns if not c.rare or {*_column(c, rows, "{}", everything=True)} != {"–"}]


def _column(column: Column, rows: Rows, bold: str, everything: bool = False) -> list[str]:
    way = "all_full" if everything else "warm_cropped"
    figures = [column.figure(row["summary"][way]) for row in rows]
    known = [float(f) for f in figures if f != "–"]  # as shown: equal figures are equally good
    best = (max if column.higher else min)(known, default=None)
    return [bold.format(f) if f != "–" and float(f) == best else f for f in figures]


def shot_tables(record: Record, *, everything: bool = False) -> list[Titled]:
    """Return caption and rows of each shot."""
    return [(caption(shot, everything=everything), shot["methods"]) for shot in record["shots"]]


def mean_tables(record: Record, *, everything: bool = False) -> dict[float, Titled]:
    """Return caption and rows of the mean at each ratio; nothing for one shot."""
    found: dict[float, Titled] = {}
    for ratio, shots in shots_by_ratio(record["shots"]).items():
        names = ", ".join(shot["name"] for shot in shots)
        title = (
            f"Mean of the shots {names} at ratio {ratio:g} to {size_text(shots[0]['display_size'])}: "
            f"{shots[0]['frames']} frames each, {_counted(everything)}"
        )
        found[ratio] = title, [mean for mean in record["means"] if mean["ratio"] == ratio]
    return found


def tables_of(record: Record, *, everything: bool = False) -> list[Titled]:
    """Return the tables of the means, or of the shot where there is only one."""
    means = mean_tables(record, everything=everything)
    return list(means.values()) or shot_tables(record, everything=everything)


def block_names(name: str) -> list[str]:
    """Return the names of the blocks of a Markdown file that `blocks` fills."""
    return [name, f"{name} clip", f"{name} classes"]


def blocks(record: Record, name: str) -> dict[str, str]:
    """Return the Markdown of each block that `--update` fills, by the block's name.

    The first is the table that README shows; the second has the metrics of all pixels, without and then with
    warm-up and border; the third compares predicted with true classes.
    """
    titled, whole = tables_of(record), tables_of(record, everything=True)
    first = [markdown_table(*t) for t in titled]
    clip = [markdown_table(*t, CLIP_COLUMNS) for t in titled]
    clip += [markdown_table(*t, CLIP_COLUMNS, everything=True) for t in whole]
    classes = [(title, class_tables(rows)) for title, rows in titled]
    shown = [f"{text}\n\n{title}." for title, text in classes if text] or [NO_CLASSES]
    return dict(zip(block_names(name), ("\n\n".join(texts) for texts in (first, clip, shown)), strict=True))


def caption(shot: Record, *, everything: bool = False) -> str:
    """Return in one line what was measured on a shot."""
    scored = sum(frame >= WARM_UP_FRAMES or everything for frame in shot["reference_frames"])
    return f"{sizes(shot)}: {scored} reference frames of {shot['frames']}, {_counted(everything)}"


def sizes(shot: Record) -> str:
    """Return the name of a shot with references and its sizes."""
    return f"{shot['name']}, {size_text(shot['render_size'])} to {size_text(shot['display_size'])}"


def _counted(everything: bool) -> str:
    if everything:
        return "from the first frame and to the border"
    return f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"
