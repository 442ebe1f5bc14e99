"""Run logs continue after a stop and drop rows beyond the checkpoint."""

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from supersampler.cli import app
from supersampler_model.training.run_log import RunLog


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "log.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_are_added_and_those_of_later_steps_dropped(tmp_path: Path) -> None:
    with RunLog(tmp_path, ["loss"]) as log:
        log.write(10, {"loss": 0.5, "psnr": 30.0})
        log.write(20, {"loss": 0.4, "psnr": 31.0, "visibility": 0.2}, np.zeros((4, 6, 3), np.float32))
    with RunLog(tmp_path, ["loss"]) as log:
        log.write(20, {"loss": 0.3, "psnr": 32.0})
    assert [(row["step"], row["loss"]) for row in rows(tmp_path)] == [("10.0", "0.5"), ("20.0", "0.3")]
    assert (tmp_path / "curves.png").stat().st_size > 1000
    assert (tmp_path / "image.png").exists()
    assert list((tmp_path / "tensorboard").iterdir())


def test_curves_have_a_panel_of_classes_only_where_there_are_classes(tmp_path: Path) -> None:
    with RunLog(tmp_path, ["image", "rough"]) as log:
        log.write(10, {"image": 0.5, "rough": 0.1, "psnr": 30.0})
        without = width(tmp_path / "curves.png")
        log.write(20, {"image": 0.4, "rough": 0.1, "psnr": 31.0, "visibility": 0.2})
    assert 3 * without == 2 * width(tmp_path / "curves.png")


@pytest.mark.parametrize("name", ["weights.safetensors", "log.csv", "curves.png", "image.png"])
def test_a_run_does_not_begin_over_files_of_others(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"mine")
    done = CliRunner().invoke(
        app, ["train", "classifier", "--data", str(tmp_path / "none"), "-o", str(tmp_path)]
    )
    assert done.exit_code == 1
    assert f"{name}: is there already, and is not of a run in this folder" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]


def width(image: Path) -> int:
    return int.from_bytes(image.read_bytes()[16:20], "big")
