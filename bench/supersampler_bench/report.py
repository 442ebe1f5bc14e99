"""What a measurement of one shot, or of all test shots, says: tables, Markdown, a record."""

from collections.abc import Iterable, Sequence
from typing import Any

from supersampler_bench.class_table import class_tables
from supersampler_bench.record import Measured, quality_record
from supersampler_bench.scores import MeanScores
from supersampler_bench.table import (
    CLIP_COLUMNS,
    Summaries,
    caption,
    coverage,
    markdown_table,
    mean_caption,
)

Titled = tuple[str, Summaries]
NO_CLASSES = "No method tells classes, or the shots have no truth of them."


def block_names(name: str) -> list[str]:
    """Return the names of the blocks of a Markdown file that `Report.blocks` fills."""
    return [name, f"{name} clip", f"{name} classes"]


class Report:
    """The scores of methods on one shot; or on several, with the mean at each of their ratios.

    Args:
        measured: the shots; of several each knows its ratio (`Measured.origin`), and all have the same
            methods.
    """

    def __init__(self, measured: Sequence[Measured]) -> None:
        self.measured = measured
        ratios = dict.fromkeys(m.origin["ratio"] for m in measured) if len(measured) > 1 else ()
        self._by_ratio = {r: [m for m in measured if m.origin["ratio"] == r] for r in ratios}
        self.means = {r: _means(of_ratio) for r, of_ratio in self._by_ratio.items()}

    def shot_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return caption and scores of each shot."""
        return [(caption(m.shot, m.methods, everything=everything), m.methods) for m in self.measured]

    def mean_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return caption and scores of the mean at each ratio; nothing for one shot."""
        return [
            (mean_caption([m.shot for m in shots], ratio, everything=everything), self.means[ratio])
            for ratio, shots in self._by_ratio.items()
        ]

    def blocks(self, name: str) -> dict[str, str]:
        """Return the Markdown of each block that `--update` fills, by the block's name.

        Tables of the means; those of the shot where there is only one.

        Args:
            name: of what was measured.
        """
        tables, of_all = (
            self.mean_tables(everything=everything) or self.shot_tables(everything=everything)
            for everything in (False, True)
        )
        first, clip, classes = block_names(name)
        return {
            first: _joined("\n".join([markdown_table(*t), *coverage(t[1])]) for t in tables),
            clip: _joined(
                [
                    *(markdown_table(*t, CLIP_COLUMNS) for t in tables),
                    *(markdown_table(*t, CLIP_COLUMNS, everything=True) for t in of_all),
                ]
            ),
            classes: _joined(
                f"{text}\n\n{title}." for title, scores in tables if (text := class_tables(scores))
            )
            or NO_CLASSES,
        }

    def record(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        return quality_record(self.measured, self.means)


def _means(measured: Sequence[Measured]) -> list[MeanScores]:
    by_method = zip(*(m.methods for m in measured), strict=True)
    return [MeanScores(scores[0].method, list(scores)) for scores in by_method]


def _joined(texts: Iterable[str]) -> str:
    return "\n\n".join(texts)
