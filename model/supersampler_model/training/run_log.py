"""The log of a training run: CSV, curves, an image, and TensorBoard."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch.utils.tensorboard import SummaryWriter

from supersampler.frame import Float32
from supersampler.io.display import to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import write_png

FILES = ("log.csv", "curves.png", "image.png", "tensorboard")
"""Files of a log in the folder of its run."""
_SCORES = ("psnr", "tpsnr")  # prefixes of columns in dB


class RunLog:
    """Appends rows to `log.csv` and rewrites `curves.png` and `image.png`.

    Args:
        folder: of the run; an existing log is continued.
        losses: columns with terms of the loss; columns that are no scores either are class overlaps.
    """

    def __init__(self, folder: Path, losses: Sequence[str]) -> None:
        self._folder, self._losses = folder, tuple(losses)
        self._path = folder / "log.csv"
        self._writer = SummaryWriter(str(folder / "tensorboard"))
        self._rows = _read(self._path)

    def __enter__(self) -> "RunLog":
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def write(self, step: int, values: Mapping[str, float], image: Float32 | None = None) -> None:
        """Add a row.

        Args:
            step: updates done; rows of later steps, from a killed run, are dropped.
            values: by column.
            image: (H, W, 3) display values.
        """
        self._rows = [row for row in self._rows if row["step"] < step]
        self._rows.append({"step": float(step), **values})
        columns = list(dict.fromkeys(name for row in self._rows for name in row))
        with replacing(self._path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, columns)
            table.writeheader()
            table.writerows(self._rows)
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)
        if image is not None:
            shown = to_uint8(image)
            write_png(self._folder / "image.png", shown)
            self._writer.add_image("image", shown, step, dataformats="HWC")
        self._draw(columns)

    def _draw(self, columns: list[str]) -> None:
        """Plot a panel of losses, one of scores and, if there are any, one of class overlaps."""
        scores = tuple(column for column in columns if column.startswith(_SCORES))
        listed = {*self._losses, *scores, "step"}
        panels = [("loss", self._losses), ("dB", scores)]
        if classes := tuple(column for column in columns if column not in listed):
            panels.append(("intersection over union", classes))
        figure = Figure(figsize=(5.0 * len(panels), 4.5), layout="constrained")
        steps = [row["step"] for row in self._rows]
        for axes, (title, names) in zip(figure.subplots(1, len(panels)), panels, strict=True):
            for name in (n for n in names if n in columns):
                axes.plot(steps, [row.get(name, np.nan) for row in self._rows], label=name)
            axes.set(title=title, xlabel="updates")
            axes.grid(alpha=0.3)
            if axes.lines:
                axes.legend(fontsize="small")
        with replacing(self._folder / "curves.png") as partial:
            FigureCanvasAgg(figure).print_png(partial)  # type: ignore[no-untyped-call]


def _read(path: Path) -> list[dict[str, float]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items() if value} for row in csv.DictReader(file)]
