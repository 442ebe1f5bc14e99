"""A figure as a file."""

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from supersampler.io.atomic import replacing


def save_png(figure: Figure, path: Path) -> None:
    """Write a figure, whole or not at all.

    Raises:
        ShotError: the file cannot be written.
    """
    with replacing(path) as partial:
        FigureCanvasAgg(figure).print_png(partial)  # type: ignore[no-untyped-call]
