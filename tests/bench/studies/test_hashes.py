"""Hashes are equal from run to run, and differ where an image or a history differs."""

import copy
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer import Typer
from typer.testing import CliRunner

from studies import hashes
from studies.hashes import (
    FRAMES,
    SIZES,
    ModelRun,
    differences,
    hashes_record,
    measure_hashes,
    scene,
    subjects,
)
from supersampler.methods.model_file import model_names
from supersampler_bench.record import Provenance

FROZEN = Path(__file__).parents[3] / "bench" / "results" / "studies" / "hashes.json"
SMALL = ((32, 18), (48, 27))


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    results = measure_hashes(subjects(["taa"]), [SMALL])
    return {**hashes_record(results), **asdict(Provenance.now())}


def test_a_method_is_hashed_in_every_way_that_it_runs() -> None:
    found = [(s.method, s.extrapolation, s.executor, s.precision, s.still) for s in subjects(["taa"])]
    assert found == [
        ("taa", None, "onnx", "fp32", False),
        ("taa", None, "cpu", "fp32", False),
        ("taa", None, "cpu", "fp32", True),
    ]


def test_sizes_of_ratios_that_a_method_lacks_are_left_out() -> None:
    [subject, *_] = subjects(["classifier-large"])
    counted: list[None] = []
    sizes = ((16, 9), (24, 14)), ((16, 9), (48, 27))
    found = measure_hashes([subject], sizes, on_run=lambda: counted.append(None))
    assert [(one.render, one.display) for one in found] == [sizes[0]]
    assert len(counted) == len(sizes)


def test_a_second_run_has_the_same_hashes(record: dict[str, Any]) -> None:
    again = hashes_record(measure_hashes(subjects(["taa"]), [SMALL]))
    assert list(differences(record, again)) == []
    assert all(len(set(row["frames"])) > FRAMES // 2 for row in record["hashed"])


def test_the_first_image_that_differs_is_named_and_how_far(record: dict[str, Any]) -> None:
    other, before = copy.deepcopy(record), record["hashed"][1]["sketches"]
    other["hashed"][1]["frames"][5] = other["hashed"][1]["frames"][7] = "0"
    other["hashed"][1]["sketches"] = [value + 2e-6 for value in before]
    (text,) = differences(record, other)
    assert text.startswith("taa, cpu fp32, 32x18 to 48x27: 2 of 24 images differ")
    assert "first is frame 5" in text
    assert "about 2e-06" in text


def test_a_history_that_differs_a_run_that_is_missing_and_other_frames_are_named(
    record: dict[str, Any],
) -> None:
    other = copy.deepcopy(record)
    other["hashed"][0]["history"]["history.color"] = "0"
    other["inputs"]["32x18 to 48x27, at rest"] = "0"
    other["hashed"][2]["frames"][0] = "0"
    del other["hashed"][1]
    frames, history, missing = differences(record, other)
    assert "input frames differ" in frames
    assert history.endswith("these history tensors differ: history.color")
    assert missing == "taa, cpu fp32, 32x18 to 48x27: missing"
    assert list(differences(record, {**record, "hashed": record["hashed"][:2]}, partly=True)) == []


def test_a_sketch_measures_the_distance_of_images(monkeypatch: pytest.MonkeyPatch) -> None:
    subject = ModelRun("bilinear", None, "onnx", "fp32", False)
    (before,) = measure_hashes([subject], [SMALL])
    frames = scene(*SMALL)
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (18, 32, 3)).astype(np.float32)
    noisy = [replace(frame, color=np.maximum(np.asarray(frame.color) + noise, 0.0)) for frame in frames]
    shown = [np.asarray(frame.color) / (1.0 + np.asarray(frame.color)) for frame in (*frames, *noisy)]
    truth = np.sqrt(np.mean((np.stack(shown[:FRAMES]) - np.stack(shown[FRAMES:])) ** 2))
    monkeypatch.setattr(hashes, "scene", lambda *_, **_options: noisy)
    (after,) = measure_hashes([subject], [SMALL])
    estimate = np.sqrt(np.mean(np.subtract(before.sketches, after.sketches) ** 2))
    assert 0.3 * truth < estimate < 1.5 * truth  # bilinear averages some of the noise


@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_most_of_the_scene_at_rest_is_frozen(method: str) -> None:
    upscaler = hashes._upscaler(ModelRun(method, None, "cpu", "auto", True), SIZES[0][1])
    for frame in scene(*SIZES[0], still=True):
        upscaler.step(frame)
    assert (upscaler.stats.converged or 0.0) > 0.5


def test_the_command_compares_with_a_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hashes, "SIZES", (SMALL,))
    run, file = CliRunner().invoke, tmp_path / "hashes.json"
    app, arguments = Typer(), ["--methods", "bilinear"]
    app.command()(hashes.main)
    assert run(app, [*arguments, "--json", str(file)]).exit_code == 0
    assert run(app, [*arguments, "--check", str(file)]).exit_code == 0
    record = json.loads(file.read_text())
    record["hashed"][0]["frames"][0] = "0"
    record["machine"]["cpu"] = "another"
    file.write_text(json.dumps(record))
    result = run(app, [*arguments, "--check", str(file)])
    assert result.exit_code == 1
    assert "the first is frame 0" in result.output
    assert "machine another" in result.output


def test_the_frozen_record_has_every_way_of_every_method() -> None:
    rows = json.loads(FROZEN.read_text())["hashed"]
    recorded = {(row["subject"]["method"], row["subject"]["extrapolation"]) for row in rows}
    assert {pair for pair in recorded if pair[1]} == set(hashes.EXTRAPOLATED)
    assert {name for name, _ in recorded} == set(model_names())
