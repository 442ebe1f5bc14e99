"""The log of a training run: CSV and TensorBoard."""

import csv
from collections.abc import Mapping
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from supersampler.frame import Float32
from supersampler.io.display import to_uint8
from supersampler.io.files import replacing

FILES = ("log.csv", "tensorboard")  # in the folder of a run


def write_log(folder: Path, step: int, values: Mapping[str, float], image: Float32 | None = None) -> None:
    """Add values to `log.csv`, and with an image (H, W, 3) of display values to TensorBoard.

    `step` is the number of updates done. Rows of later steps, from a killed run, are removed.
    """
    path = folder / "log.csv"
    rows = [row for row in _read(path) if row["step"] < step]
    rows.append({"step": float(step), **values})
    with replacing(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)))
        table.writeheader()
        table.writerows(rows)
    with SummaryWriter(str(folder / "tensorboard")) as writer:
        for name, value in values.items():
            writer.add_scalar(name, value, step)
        if image is not None:
            writer.add_image("image", to_uint8(image), step, dataformats="HWC")


def _read(path: Path) -> list[dict[str, float]]:
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [{name: float(value) for name, value in row.items() if value} for row in csv.DictReader(file)]
