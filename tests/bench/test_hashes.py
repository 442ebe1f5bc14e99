"""Hashes are equal from run to run, and differ where an image or a history differs."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from supersampler.methods.model_file import model_names
from supersampler_bench import hashes
from supersampler_bench.record import read_record
from upscale_runs import run, succeeded

FROZEN = Path(__file__).parents[2] / "bench" / "hashes.json"
SMALL = ((32, 18), (48, 27))


@pytest.fixture(scope="module")
def record() -> hashes.HashesRecord:
    return hashes.HashesRecord.of(hashes.measure_hashes(hashes.subjects(["taa"]), [SMALL]))


def test_a_method_is_hashed_in_every_way_that_it_runs() -> None:
    found = [(s.method, s.extrapolation, s.executor, s.precision, s.still) for s in hashes.subjects(["taa"])]
    assert found == [
        ("taa", None, "onnx", "fp32", False),
        ("taa", None, "cpu", "fp32", False),
        ("taa", None, "cpu", "fp32", True),
    ]


def test_a_method_skips_sizes_of_ratios_that_it_lacks() -> None:
    [subject, *_] = hashes.subjects(["classifier-large"])
    counted: list[None] = []
    sizes = ((16, 9), (24, 14)), ((16, 9), (48, 27))
    found = hashes.measure_hashes([subject], sizes, on_run=lambda: counted.append(None))
    assert [(one.render, one.display) for one in found] == [sizes[0]]
    assert len(counted) == len(sizes)


def test_a_second_run_has_the_same_hashes(record: hashes.HashesRecord) -> None:
    again = hashes.HashesRecord.of(hashes.measure_hashes(hashes.subjects(["taa"]), [SMALL]))
    assert list(hashes.differences(record, again)) == []
    assert all(len(set(run.frames)) > hashes.FRAMES // 2 for run in record.hashed)


def test_images_histories_runs_and_input_frames_that_differ_are_named(record: hashes.HashesRecord) -> None:
    onnx, cpu, still = record.hashed
    frames = [*cpu.frames[:5], "0", cpu.frames[6], "0", *cpu.frames[8:]]
    forgotten = replace(onnx, history={**onnx.history, "history.color": "0"})
    image, history = hashes.differences(
        replace(record, hashed=[cpu, onnx]), replace(record, hashed=[replace(cpu, frames=frames), forgotten])
    )
    assert image == "taa, cpu fp32, 32x18 to 48x27: 2 of 16 images differ, the first is frame 5"
    assert history.endswith("these history tensors differ: history.color")
    other = replace(record, inputs={**record.inputs, "32x18 to 48x27, at rest": "0"}, hashed=[onnx])
    inputs, missing = hashes.differences(record, other)
    assert "at rest: the input frames differ" in inputs
    assert missing == "taa, cpu fp32, 32x18 to 48x27: missing"
    assert list(hashes.differences(record, replace(record, hashed=[onnx, still]), partly=True)) == []
    [added] = hashes.differences(replace(record, hashed=[onnx, still]), record, partly=True)
    assert added == "taa, cpu fp32, 32x18 to 48x27: not in the record"


@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_most_of_the_scene_at_rest_is_frozen(method: str) -> None:
    upscaler = hashes.upscaler_of(hashes.ModelRun(method, None, "cpu", "auto", True), hashes.SIZES[0][1])
    for frame in hashes.scene(*hashes.SIZES[0], still=True):
        upscaler.step(frame)
    assert (upscaler.stats.converged or 0.0) > 0.5


def test_the_command_compares_with_a_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hashes, "SIZES", (SMALL,))
    file, arguments = tmp_path / "hashes.json", ("bench", "hashes", "--methods", "bilinear")
    succeeded(run(*arguments, "--json", file))
    succeeded(run(*arguments, "--check", file))
    record = json.loads(file.read_text())
    record["hashed"][0]["frames"][0] = "0"
    record["machine"]["cpu"] = "another"
    file.write_text(json.dumps(record))
    result = run(*arguments, "--check", file)
    assert result.exit_code == 1
    assert "the first is frame 0" in result.output
    assert "machine another" in result.output


def test_the_frozen_record_has_every_run_of_every_method() -> None:
    runs = hashes.HashesRecord.from_json(read_record(FROZEN)).hashed
    recorded = {(run.subject.method, run.subject.extrapolation) for run in runs}
    assert {pair for pair in recorded if pair[1]} == set(hashes.EXTRAPOLATED)
    assert {name for name, _ in recorded} == set(model_names())
