"""The log of a training run: CSV and TensorBoard."""

import csv
from collections.abc import Mapping
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter

from supersampler.errors import ShotError
from supersampler.frame import Float32
from supersampler.io.display import to_uint8
from supersampler.io.files import replacing

TABLE = "log.csv"  # in the folder of a run
FILES = (TABLE, "tensorboard")


def write_log(folder: Path, step: int, values: Mapping[str, float], image: Float32 | None = None) -> None:
    """Add values to `log.csv`, and with an image (H, W, 3) of display values to TensorBoard.

    `step` is the number of updates done. Rows of later steps, from a killed run, are removed.
    """
    rows = [row for row in read_log(folder) if row["step"] < step]
    rows.append({"step": float(step), **values})
    with replacing(folder / TABLE) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, list(dict.fromkeys(name for row in rows for name in row)))
        table.writeheader()
        table.writerows(rows)
    with SummaryWriter(str(folder / "tensorboard")) as writer:
        for name, value in values.items():
            writer.add_scalar(name, value, step)
        if image is not None:
            writer.add_image("image", to_uint8(image), step, dataformats="HWC")


def read_log(folder: Path) -> list[dict[str, float]]:
    """Return the rows of `log.csv`; [] if there is none.

    Raises:
        ShotError: the file is damaged, or another program has rewritten it.
    """
    path = folder / TABLE
    if not path.exists():
        return []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = [{k: float(value) for k, value in row.items() if value} for row in csv.DictReader(file)]
        return sorted(rows, key=lambda row: row["step"])
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        problem = f"is not the log of a run ({type(error).__name__}: {error})"
        raise ShotError(path, problem, "Move it away; the same command then begins a new one.") from error
