"""The folder of figures that `bench quality -o` writes: a folder for each shot, and the classes of all."""

from pathlib import Path

from supersampler_bench.quality import figures
from supersampler_bench.quality.class_table import confusions_of
from supersampler_bench.quality.error_maps import ErrorMaps
from supersampler_bench.quality.score_record import Measured, shot_record
from supersampler_bench.quality.score_report import Report
from supersampler_bench.quality.score_table import caption, sizes
from supersampler_model.data.shots import variant_name


class FigureFolder:
    """Writes figures into a folder, over those of the same names.

    Args:
        folder: made with the first figure.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, measured: Measured, maps: ErrorMaps) -> None:
        """Draw curves, errors and, where a method predicts them, classes of one shot."""
        shot, results = measured.shot, measured.methods
        facts = shot_record(shot)
        ratio = measured.origin.get("ratio")
        folder = self._folder / (shot.name if ratio is None else f"{shot.name}-{variant_name(ratio)}")
        figures.draw_curves(sizes(facts), results, folder / "curves.png")
        figures.draw_errors(sizes(facts), maps, folder / "errors.png")
        if confusions := confusions_of(results):
            figures.draw_classes(caption(facts), confusions, folder / "classes.png")

    def add_means(self, report: Report) -> None:
        """Draw the classes of all shots at each ratio, where there are several shots."""
        for (title, scores), ratio in zip(report.mean_tables(), report.ratios, strict=True):
            if confusions := confusions_of(scores):
                figures.draw_classes(title, confusions, self._folder / f"classes-{variant_name(ratio)}.png")
