"""Benches add the G-buffers that a method reads, and name the methods that they leave out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gbuffer_method import WANTED, exported, lit
from noise import noise
from supersampler import ArgumentError, Shot, Upscaler
from supersampler.io.display import auto_exposure, display_transform
from supersampler.io.shot import ShotWriter
from supersampler.methods.gbuffers import GBUFFERS, gbuffer_arrays
from supersampler.validation import FrameChecker
from supersampler_bench.quality.measure import measure_quality, runnable
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.specs import gbuffers_of, incompatibility, with_default_gbuffers
from supersampler_bench.stress.runner import chosen, left_out, measure, runs
from supersampler_bench.stress.subjects import subjects
from supersampler_bench.timing.latency import measure_latency

RENDER, DISPLAY = (32, 18), (64, 36)


@pytest.fixture(scope="module")
def gbuffer_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory)


def test_default_buffers_are_valid_for_any_frame() -> None:
    frame = with_default_gbuffers(noise(1, (96, 54)), GBUFFERS, (192, 108))
    assert [*gbuffer_arrays(frame)] == [*GBUFFERS]
    FrameChecker("strict").check(frame, (192, 108), GBUFFERS)
    bad = replace(noise(1), depth=np.full(RENDER[::-1], np.nan, np.float32))
    assert all(
        np.isfinite(np.asarray(place.find(with_default_gbuffers(bad, GBUFFERS, DISPLAY)))).all()
        for place in GBUFFERS.values()
    )


def test_only_missing_buffers_that_are_requested_get_defaults() -> None:
    frame = lit(1)
    assert with_default_gbuffers(frame, WANTED, DISPLAY) is frame
    assert with_default_gbuffers(frame, (), DISPLAY) is frame
    part = with_default_gbuffers(lit(1, drop=WANTED[0]), WANTED, DISPLAY)
    assert set(gbuffer_arrays(part)) == set(WANTED)
    np.testing.assert_array_equal(GBUFFERS[WANTED[1]].find(part), GBUFFERS[WANTED[1]].find(frame))


def test_a_method_is_left_out_for_its_ratio_or_for_missing_inputs(gbuffer_model: Path) -> None:
    name = str(gbuffer_model)
    assert incompatibility(name, RENDER, DISPLAY) == incompatibility(name, RENDER, DISPLAY, WANTED) == ""
    assert incompatibility("taau", (33, 19), (49, 28), ()) == ""
    assert f"{name} is left out: frame.size is (32, 18)" in incompatibility(name, RENDER, (96, 54))
    assert "the frames have no normal at display size." in incompatibility(name, RENDER, DISPLAY, WANTED[1:2])
    assert gbuffers_of([name, "taau"]) == set(WANTED)


def test_latency_times_a_method_with_buffers_at_its_ratio(gbuffer_model: Path) -> None:
    name, unfit = str(gbuffer_model), list[str]()
    sizes = [DISPLAY, (65, 36)]
    results = measure_latency([name, "bilinear"], sizes, ["onnx"], [1], steps=1, on_left_out=unfit.append)
    assert [(r.setting.method, r.setting.display[0]) for r in results] == [
        ("taa", 64), (name, 64), ("bilinear", 64), ("taa", 65), ("bilinear", 65),
    ]  # fmt: skip
    assert len(unfit) == 1
    assert "(65, 36)" in unfit[0]


def test_stress_adds_buffers_and_names_scenarios_of_other_ratios(gbuffer_model: Path) -> None:
    stressed = subjects([str(gbuffer_model), "bilinear"], ["onnx"])
    scenarios = chosen(["a cut in every frame", "ratios from 1 to 3"])
    planned = [(scenario.name, Path(subject.method).name) for scenario, subject in runs(scenarios, stressed)]
    assert planned == [
        ("a cut in every frame", "demodulated"), ("a cut in every frame", "bilinear"),
        ("ratios from 1 to 3", "bilinear"),
    ]  # fmt: skip
    (text,) = left_out(scenarios, stressed)
    assert text.endswith("whose only ratio is 2, is left out of ratios from 1 to 3")
    for outcome in measure(chosen(["a cut in every frame", "threads"]), stressed[:1], quick=True):
        assert outcome.passed, outcome


@pytest.fixture
def shot(tmp_path: Path) -> Shot:
    with ShotWriter(tmp_path / "lit", name="lit", display_size=DISPLAY, frame_rate=24) as writer:
        for seed in range(2):
            writer.write(lit(seed), reference=np.full((*DISPLAY[::-1], 3), 0.5, np.float16))
    return Shot.open(tmp_path / "lit")


def test_quality_is_measured_with_the_buffers_of_a_shot(shot: Shot, gbuffer_model: Path) -> None:
    name = str(gbuffer_model)
    scores = measure_quality(shot, ["bilinear", name])
    assert [score.method for score in scores] == ["bilinear", name]
    upscaler = Upscaler(gbuffer_model, display_size=DISPLAY)
    reference = np.full((*DISPLAY[::-1], 3), 0.5, np.float32)
    exposure = auto_exposure(reference)
    for frame, item in zip(scores[1].frames, shot, strict=True):
        image = display_transform(upscaler.step(item.frame), exposure)
        assert frame.full["psnr"] == psnr(image, display_transform(reference, exposure))


def test_quality_names_the_methods_it_leaves_out(shot: Shot, gbuffer_model: Path) -> None:
    name, unfit = str(gbuffer_model), list[str]()
    assert runnable(shot, ["bilinear:off", name], unfit.append) == ["bilinear:off", name]
    assert unfit == []
    assert runnable(Shot.open("plaza"), ["taau", name], unfit.append) == ["taau"]
    assert len(unfit) == 1
    assert unfit[0].startswith(f"plaza: {name} is left out: the frames have no base_color, normal at display")
    with pytest.raises(ArgumentError, match="one that can upscale plaza"):
        runnable(Shot.open("plaza"), [name], unfit.append)
