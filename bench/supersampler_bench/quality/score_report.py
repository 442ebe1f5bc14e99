"""Tables of a quality record, of one shot or of all test shots, as Markdown blocks."""

from collections.abc import Iterable

from supersampler_bench.quality.class_table import class_tables
from supersampler_bench.quality.score_record import RecordedScores
from supersampler_bench.quality.score_table import (
    CLIP_COLUMNS,
    ShotFacts,
    Summaries,
    caption,
    markdown_table,
    mean_caption,
)
from supersampler_bench.record import Record

Titled = tuple[str, Summaries]
NO_CLASSES = "No method predicts classes, or the shots have no true classes."


def block_names(name: str) -> list[str]:
    """Return the names of the blocks of a Markdown file that `Report.blocks` fills."""
    return [name, f"{name} clip", f"{name} classes"]


class Report:
    """The scores of methods on one shot; or on several, with the mean at each of their ratios.

    Args:
        record: by `quality_record`, or read back.
    """

    def __init__(self, record: Record) -> None:
        self.record = record
        self.ratios: list[float] = list(dict.fromkeys(mean["ratio"] for mean in record["means"]))

    def shot_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return caption and scores of each shot."""
        return [
            (caption(shot, everything=everything), [RecordedScores(row) for row in shot["methods"]])
            for shot in self.record["shots"]
        ]

    def mean_tables(self, *, everything: bool = False) -> list[Titled]:
        """Return caption and scores of the mean at each ratio; nothing for one shot."""
        return [
            (
                mean_caption(self._shots(ratio), ratio, everything=everything),
                [RecordedScores(mean) for mean in self.record["means"] if mean["ratio"] == ratio],
            )
            for ratio in self.ratios
        ]

    def _shots(self, ratio: float) -> list[ShotFacts]:
        return [shot for shot in self.record["shots"] if shot["ratio"] == ratio]

    def _tables(self, *, everything: bool = False) -> list[Titled]:
        """Return the tables of the means; those of the shot where there is only one."""
        return self.mean_tables(everything=everything) or self.shot_tables(everything=everything)

    def frame_block(self) -> str:
        """Return the table that README shows."""
        return _joined(markdown_table(*t) for t in self._tables())

    def clip_block(self) -> str:
        """Return the metrics of all pixels: without warm-up and border, then with them."""
        whole = [markdown_table(*t, CLIP_COLUMNS, everything=True) for t in self._tables(everything=True)]
        return _joined([*(markdown_table(*t, CLIP_COLUMNS) for t in self._tables()), *whole])

    def class_block(self) -> str:
        """Return predicted against true classes."""
        told = [(title, class_tables(scores)) for title, scores in self._tables()]
        return _joined(f"{text}\n\n{title}." for title, text in told if text) or NO_CLASSES

    def blocks(self, name: str) -> dict[str, str]:
        """Return the Markdown of each block that `--update` fills, by the block's name.

        Args:
            name: of what was measured.
        """
        texts = (self.frame_block(), self.clip_block(), self.class_block())
        return dict(zip(block_names(name), texts, strict=True))


def _joined(texts: Iterable[str]) -> str:
    return "\n\n".join(texts)
