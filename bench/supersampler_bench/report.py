"""What a measurement of one shot, or of all test shots, says: tables, Markdown, a record."""

from collections.abc import Sequence
from typing import Any

from supersampler_bench.quality import MeanScores
from supersampler_bench.record import Measured, quality_record
from supersampler_bench.table import Summaries, caption, markdown_table, mean_caption


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

    def shot_tables(self) -> list[tuple[str, Summaries]]:
        """Return caption and scores of each shot."""
        return [(caption(m.shot, m.methods), m.methods) for m in self.measured]

    def mean_tables(self) -> list[tuple[str, Summaries]]:
        """Return caption and scores of the mean at each ratio; nothing for one shot."""
        titles = {r: mean_caption([m.shot for m in shots], r) for r, shots in self._by_ratio.items()}
        return [(titles[r], self.means[r]) for r in titles]

    def markdown(self) -> str:
        """Return the tables of the means; that of the shot where there is only one."""
        tables = self.mean_tables() or self.shot_tables()
        return "\n\n".join(markdown_table(title, scores) for title, scores in tables)

    def record(self) -> dict[str, Any]:
        """Return everything, ready for JSON."""
        return quality_record(self.measured, self.means)


def _means(measured: Sequence[Measured]) -> list[MeanScores]:
    by_method = zip(*(m.methods for m in measured), strict=True)
    return [MeanScores(scores[0].method, list(scores)) for scores in by_method]
