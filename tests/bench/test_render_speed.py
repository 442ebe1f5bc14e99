"""The rendering bench draws real samples of every family, and its figures fit each other."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from supersampler.cli import app
from supersampler_model.data.sequences import TRAIN_FAMILIES


def test_a_tiny_measurement_is_whole_and_consistent(tmp_path: Path) -> None:
    file = tmp_path / "render.json"
    options = ["--size", "48x28", "--samples", "4", "--workers", "2", "--frames", "3", "--json", str(file)]
    done = CliRunner().invoke(app, ["bench", "render", *options])
    assert done.exit_code == 0, done.output
    record = json.loads(file.read_text(encoding="utf-8"))
    assert record["frames"] == 3 * 2 * len(TRAIN_FAMILIES)
    seconds, rates = record["seconds_per_sample"], record["samples_per_hour"]
    assert list(seconds) == [*TRAIN_FAMILIES, "all"]
    for name, value in seconds.items():
        assert rates[name] == pytest.approx(2 * 3600 / value)
        assert f"{rates[name]:.0f}" in done.stdout
    assert seconds["all"] == pytest.approx(sum(seconds[f] for f in TRAIN_FAMILIES) / len(TRAIN_FAMILIES))
    assert record["wall"]["samples_per_hour"] == pytest.approx(
        record["frames"] / record["wall"]["seconds"] * 3600
    )
    shares = record["share_of_time"]
    assert sum(shares.values()) == pytest.approx(1.0)
    assert all(share > 0.0 for share in shares.values())


@pytest.mark.parametrize("option", [("--frames", "2"), ("--workers", "0")])
def test_what_cannot_be_measured_is_refused(option: tuple[str, str]) -> None:
    assert CliRunner().invoke(app, ["bench", "render", *option]).exit_code == 2
