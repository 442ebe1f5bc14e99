"""Quality records and their tables, for the terminal and as blocks of Markdown files."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, TypeAlias

from rich.table import Column as TableColumn
from rich.table import Table
from rich.text import Text

from supersampler.cli.arguments import size_text
from supersampler_bench.quality.corners import KINDS
from supersampler_bench.quality.scores import (
    BORDER,
    CLASSES,
    WARM_UP_FRAMES,
    Counts,
    MethodRow,
    ScoresRecord,
    ShotRow,
    fractions,
    mean_rows,
    overlap,
    shots_by_ratio,
)
from supersampler_bench.record import figure, sizes_text, table

Titled: TypeAlias = tuple[str, Sequence[MethodRow]]
"""Caption and rows of a table."""
NO_KINDS = "The shots have no planes of truth, which tell kinds of pixels apart."
NO_CLASSES = "No method predicts classes, or the shots have no true classes."
_MAX_METHODS = 4  # across a table of the terminal


@dataclass(frozen=True)
class Column:
    """Presentation of one metric."""

    name: str  # of the metric, in records
    title: str
    digits: int  # decimals
    higher: bool = True  # whether higher is better
    scale: float = 1.0  # factor on the value
    rare: bool = False  # whether tables omit the column if no method has a value

    @property
    def heading(self) -> str:
        """The title, with an arrow that points to the better side."""
        return f"{self.title} {'↑' if self.higher else '↓'}"

    def figure(self, scores: Mapping[str, float | None]) -> str:
        """Return the metric as text; a dash if it is unknown."""
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
"""Columns of the first table, which README shows."""
CLIP_COLUMNS = (
    *COLUMNS[:5],
    Column("strred", "STRRED", 1, higher=False),
    Column("jod", "ColorVideoVDP JOD", 2, rare=True),
)
"""Columns of the second table: metrics of all pixels and of whole clips."""
CORNER_COLUMNS = (
    Column("psnr", "PSNR dB", 2),
    Column("psnr_first", "PSNR dB, first image", 2, rare=True),
    Column("psnr_shadow_edges", "PSNR dB, shadow edges", 2, rare=True),
    Column("trail", "trail", 3, higher=False, rare=True),
    Column("color_trail", "trail in colour", 3, higher=False, rare=True),
    Column("thin_kept", "thin coverage kept", 3, rare=True),
    Column("speckle", "speckle 1e-3", 2, higher=False, scale=1000.0, rare=True),
)
"""Columns of the table of what the eye sees first."""


def markdown_table(
    title: str, rows: Sequence[MethodRow], columns: Sequence[Column] = COLUMNS, *, everything: bool = False
) -> str:
    """Return a table as Markdown, with the best figure of each column in bold.

    `title` is the caption without its full stop. With `everything`, the warm-up and the border count, too.
    """
    shown = _shown_columns(columns, rows, everything)
    figures = ([f"**{text}**" if best else text for text, best in _cells(c, rows, everything)] for c in shown)
    cells = zip(*figures, strict=True)
    headings = ["method", *(f"{column.heading}:" for column in shown)]
    named = ([row.method, *figures] for row, figures in zip(rows, cells, strict=True))
    return table(headings, named, f"{title}.")


def terminal_tables(title: str, rows: Sequence[MethodRow]) -> Iterator[Table]:
    """Yield the scores, then the error by kind of pixel and the overlap of classes if they are known.

    Tables have a column per method. More than _MAX_METHODS do not fit into 80 characters; they continue in
    another table.
    """
    shown = _shown_columns(dict.fromkeys((*COLUMNS, *CLIP_COLUMNS, *CORNER_COLUMNS)), rows)
    scores = [
        (column.heading, [Text(text, "bold" if best else "") for text, best in _cells(column, rows)])
        for column in shown
    ]
    yield from _terminal_tables("", [row.method for row in rows], scores, title)
    kinds = list(_kind_rows(rows))
    figures = [(kind, [row[place] for row in kinds]) for place, kind in enumerate(KINDS, start=1)]
    yield from _terminal_tables("fraction of the error, PSNR", [name for name, *_ in kinds], figures, title)
    confusions = confusions_of(rows)
    overlaps = [
        (f"{group}: {name}", [figure(overlap(counts[index])[number], 3) for _, counts in confusions])
        for index, (group, names) in enumerate(CLASSES.items())
        for number, name in enumerate(names)
    ]
    yield from _terminal_tables("intersection over union", [name for name, _ in confusions], overlaps, title)


def _terminal_tables(
    corner: str, methods: Sequence[str], figures: Iterable[tuple[str, Sequence[Any]]], title: str
) -> Iterator[Table]:
    """Yield tables of figures, each with the heading of its row and a value per method."""
    for first in range(0, len(methods), _MAX_METHODS):
        part = slice(first, first + _MAX_METHODS)
        columns = (TableColumn(name, justify="right", overflow="fold") for name in methods[part])
        shown = Table(corner, *columns, caption=title)
        for heading, values in figures:
            shown.add_row(heading, *values[part])
        yield shown


def _shown_columns(
    columns: Iterable[Column], rows: Sequence[MethodRow], everything: bool = False
) -> list[Column]:
    """Return the columns without the rare ones in which no row has a value."""
    return [c for c in columns if not c.rare or any(text != "–" for text, _ in _cells(c, rows, everything))]


def _cells(column: Column, rows: Sequence[MethodRow], everything: bool = False) -> list[tuple[str, bool]]:
    """Return the figure of each row as text, and whether it is the best one."""
    figures = [column.figure(row.summary["all_full" if everything else "warm_cropped"]) for row in rows]
    # rounded, so that equal figures are equally good; errors may have a sign
    goodness = [None if f == "–" else float(f) if column.higher else -abs(float(f)) for f in figures]
    best = max((good for good in goodness if good is not None), default=None)
    return [(f, good is not None and good == best) for f, good in zip(figures, goodness, strict=True)]


def confusions_of(rows: Sequence[MethodRow]) -> list[tuple[str, Counts]]:
    """Return the class counts of each method that has them."""
    return [(row.method, counts) for row in rows if (counts := row.counts()) is not None]


def class_tables(rows: Sequence[MethodRow]) -> str:
    """Return two Markdown tables for each method that has class counts; "" if none has."""
    return "\n\n".join(
        _class_table(f"{group}, `{method}`", names, matrix)
        for method, counts in confusions_of(rows)
        for (group, names), matrix in zip(CLASSES.items(), counts, strict=True)
    )


def _class_table(title: str, names: Sequence[str], matrix: Counts) -> str:
    part = matrix.sum(axis=1) / max(matrix.sum(), 1)
    rows = [
        [name, *(figure(100.0 * f, 1, " %") for f in row), figure(100.0 * of_all, 2, " %"), figure(iou, 3)]
        for name, row, of_all, iou in zip(names, fractions(matrix), part, overlap(matrix), strict=True)
    ]
    return table([title, *(f"predicted {name}:" for name in names), "of all pixels:", "IoU:"], rows)


def _kind_rows(rows: Sequence[MethodRow]) -> Iterator[list[str]]:
    """Yield a row of the pixels' fractions by KINDS, then rows of each method's error fractions and PSNR."""
    known = [row for row in rows if any(f"pixel_share_{kind}" in row.known() for kind in KINDS)]
    for row in known[:1]:
        yield ["of the pixels", *(_percentage(row, f"pixel_share_{kind}") for kind in KINDS)]
    for row in known:
        shares = (_percentage(row, f"error_share_{kind}") for kind in KINDS)
        decibels = (figure(row.known().get(f"psnr_kind_{kind}"), 2, " dB") for kind in KINDS)
        yield [row.method, *map(", ".join, zip(shares, decibels, strict=True))]


def _percentage(row: MethodRow, name: str) -> str:
    return figure(100.0 * row.known().get(name, math.nan), 1, " %")


def kind_table(title: str, rows: Sequence[MethodRow]) -> str:
    """Return a Markdown table of the error by kind of pixel; "" if kinds are unknown."""
    headings = ["fraction of the error, PSNR", *(f"{kind}:" for kind in KINDS)]
    found = list(_kind_rows(rows))
    return table(headings, found, f"{title}.") if found else ""


@dataclass(frozen=True)
class QualityRecord(ScoresRecord):
    """Scores of methods on shots, and their means at each ratio."""

    means: list[MethodRow] = field(default_factory=list)
    BENCH = "quality"
    TABLES: ClassVar[tuple[str, ...]] = ("", "clip", "classes", "corners", "kinds")

    @classmethod
    def of(cls, shots: Sequence[ShotRow]) -> Self:
        """Return the record of rows by `shot_row`."""
        return cls(list(shots), means=list(mean_rows(shots)))

    def without_frames(self) -> Self:
        """Return the record without the values of single frames, which make up most of its size."""
        shots = [replace(s, methods=[replace(row, frames=[]) for row in s.methods]) for s in self.shots]
        return replace(self, shots=shots)

    def rows(self) -> Iterator[tuple[float, MethodRow]]:
        """Yield the means, or the rows of the only shot, each with its ratio."""
        yield from ((row.ratio or 1.0, row) for row in self.means)
        if not self.means:
            yield from ((shot.real_ratio, row) for shot in self.shots for row in shot.methods)

    def shot_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return the caption and rows of each shot."""
        return [(caption(shot, everything=everything), shot.methods) for shot in self.shots]

    def mean_tables(self, *, everything: bool = False) -> dict[float, Titled]:
        """Return the caption and rows of the mean at each ratio; nothing for a single shot."""
        found: dict[float, Titled] = {}
        for ratio, shots in shots_by_ratio(self.shots).items():
            title = (
                f"Mean of the shots {', '.join(shot.name for shot in shots)} at ratio {ratio:g} to "
                f"{size_text(shots[0].display_size)}: {shots[0].frames} frames each, {_counted(everything)}"
            )
            found[ratio] = title, [mean for mean in self.means if mean.ratio == ratio]
        return found

    def main_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return the tables of the means, or of a single shot."""
        means = self.mean_tables(everything=everything)
        return list(means.values()) or self.shot_tables(everything=everything)

    def table(self) -> str:
        """Return the table that README shows."""
        return "\n\n".join(markdown_table(*titled) for titled in self.main_tables())

    def clip_table(self) -> str:
        """Return the metrics of all pixels, first without, then with warm-up and border."""
        return "\n\n".join(
            markdown_table(*titled, CLIP_COLUMNS, everything=everything)
            for everything in (False, True)
            for titled in self.main_tables(everything=everything)
        )

    def classes_table(self) -> str:
        """Return the tables of predicted and true classes."""
        texts = [(title, class_tables(rows)) for title, rows in self.main_tables()]
        return "\n\n".join(f"{text}\n\n{title}." for title, text in texts if text) or NO_CLASSES

    def corners_table(self) -> str:
        """Return the measures of what the eye sees first."""
        return "\n\n".join(markdown_table(*titled, CORNER_COLUMNS) for titled in self.main_tables())

    def kinds_table(self) -> str:
        """Return the error by kind of pixel."""
        return "\n\n".join(filter(None, (kind_table(*titled) for titled in self.main_tables()))) or NO_KINDS


def caption(shot: ShotRow, *, everything: bool = False) -> str:
    """Return one line that says what was measured on a shot."""
    scored = sum(frame >= WARM_UP_FRAMES or everything for frame in shot.reference_frames)
    return f"{sizes(shot)}: {scored} reference frames of {shot.frames}, {_counted(everything)}"


def sizes(shot: ShotRow) -> str:
    """Return the name of a shot and its sizes."""
    return f"{shot.name}, {sizes_text(shot.render_size, shot.display_size)}"


def _counted(everything: bool) -> str:
    if everything:
        return "from the first frame and to the border"
    return f"without the first {WARM_UP_FRAMES} frames and a border of {BORDER} pixels"
