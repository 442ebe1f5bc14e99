"""Unshaded frames through an Upscaler: sources of the extrapolation, and refused frames."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alternating import alternate, extrapolated_by_torch
from apart import run_apart
from lit_scene import LitScene
from noise import noise
from shared_models import shared_model
from supersampler import (
    ArgumentError,
    Frame,
    FrameError,
    Model,
    ModelError,
    StepResult,
    Upscaler,
    halton_jitter,
)
from supersampler.backends.onnx.executor import OnnxExtrapolation
from supersampler.frame import Float32
from supersampler.methods import executors
from supersampler.methods.model_file import extrapolation_names, model_names
from supersampler.methods.model_info import ModelInfo
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay
from supersampler_model.methods.guided_warp import GuidedWarp

SIZE, DISPLAY = (64, 36), (128, 72)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)


@pytest.fixture(scope="module")
def taau() -> Model:
    return shared_model("taau", "onnx")


def make(model: Model, **options: Any) -> Upscaler:
    settings = {"display_size": DISPLAY, "extrapolation": "guided-warp", "validate": "off"}
    return Upscaler(model, **{**settings, **options})


def shaded(index: int, **overrides: Any) -> Frame:
    return SCENE.frame(index, SIZE, halton_jitter(index, 2.0), **overrides)


def unshaded(index: int, **overrides: Any) -> Frame:
    return shaded(index, color=None, **overrides)


def run(upscaler: Upscaler, pattern: str, start: int = 0) -> list[Float32]:
    return alternate(upscaler, shaded, pattern, start)


@pytest.mark.parametrize("pattern", ["susu", "suusuuus", "ssuuu"])
def test_the_method_steps_on_the_extrapolated_colour(taau: Model, pattern: str) -> None:
    images, plain = run(make(taau), pattern), Upscaler(taau, display_size=DISPLAY, validate="off")
    colors = extrapolated_by_torch(GuidedWarp(), shaded, pattern)
    for index, (image, color) in enumerate(zip(images, colors, strict=True)):
        frame = shaded(index) if color is None else shaded(index, color=np.ascontiguousarray(color))
        off = np.abs(plain.step(frame) - image)
        assert off.mean() < 1e-5  # of torch and ONNX Runtime
        assert np.quantile(off, 0.99) < 1e-4


def test_an_extrapolated_frame_is_nearly_what_a_shaded_one_would_be(taau: Model) -> None:
    every, half = run(make(taau), "s" * 12), run(make(taau), "su" * 6)
    truth = [SCENE.truth(index, DISPLAY) for index in range(12)]
    errors = [
        np.mean([np.abs(i[index] - truth[index]).mean() for index in (5, 7, 9, 11)]) for i in (every, half)
    ]
    assert errors[1] < 1.3 * errors[0]


def test_without_frames_to_draw_nothing_is_different(taau: Model) -> None:
    plain = Upscaler(taau, display_size=DISPLAY, validate="off")
    for image, index in zip(run(make(taau), "ssss"), range(4), strict=True):
        np.testing.assert_array_equal(image, plain.step(shaded(index)))


def test_the_render_size_may_change_between_frames(taau: Model) -> None:
    upscaler = make(taau)
    for index, size in enumerate([(64, 36), (48, 27), (80, 45)]):
        frame = SCENE.frame(index, size, halton_jitter(index, 2.0), color=None) if index else shaded(0)
        image = upscaler.extrapolate(frame) if index else upscaler.step(frame)
        assert image.shape == (72, 128, 3)
        assert np.abs(image - SCENE.truth(index, DISPLAY)).mean() < 0.2


def test_maps_and_an_array_to_write_to_are_as_of_any_step(taau: Model) -> None:
    upscaler, out = make(taau), np.empty((72, 128, 3), np.float32)
    upscaler.step(shaded(0))
    result: Any = upscaler.extrapolate(unshaded(1), out=out, outputs=("weight",))
    assert isinstance(result, StepResult)
    assert result.image is out


# --- what is refused ---


def test_an_upscaler_without_extrapolation_says_how_to_make_one_with_it(taau: Model) -> None:
    upscaler = make(taau, extrapolation=None)
    upscaler.step(noise(1, SIZE))  # needs no G-buffers
    with pytest.raises(ArgumentError, match=r"extrapolation is None; want a model.*'guided-warp'"):
        upscaler.extrapolate(unshaded(1))


def test_calls_that_extrapolation_would_not_see_are_refused(taau: Model) -> None:
    upscaler = make(taau)
    for call in (
        lambda: upscaler.step_tensors({}, jitter=(0.0, 0.0)),
        lambda: upscaler.step_computed(unshaded(1), np.ones((36, 64, 3), np.float32)),
    ):
        with pytest.raises(ArgumentError, match="called with extrapolation"):
            call()


def test_extrapolation_models_and_upscaling_models_are_not_interchangeable(taau: Model) -> None:
    assert extrapolation_names() == ["guided-flow", "guided-warp"]
    assert not set(extrapolation_names()) & set(model_names())
    for use in (
        Model.load,
        lambda name: Upscaler(name, scale=2.0),
        lambda n: Upscaler.plan(SIZE, DISPLAY, n),
    ):
        with pytest.raises(ModelError, match=r"does not upscale.*Upscaler\(extrapolation='guided-warp'\)"):
            use("guided-warp")
    with pytest.raises(ModelError, match=r"'taau' upscales.*extrapolation takes guided-flow or guided-warp"):
        make(taau, extrapolation="taau")
    with pytest.raises(ModelError, match=r"no model 'guided-wrap'.*guided-warp"):
        make(taau, extrapolation="guided-wrap")


# --- sessions ---


def test_a_state_goes_with_and_without_extrapolation(taau: Model) -> None:
    with_it, without_it = make(taau), make(taau, extrapolation=None)
    run(with_it, "su")
    without_it.load_state(with_it.save_state())
    np.testing.assert_array_equal(without_it.step(shaded(2)), with_it.step(shaded(2)))
    with_it.load_state(without_it.save_state())
    with pytest.raises(FrameError, match="before any shaded frame"):
        with_it.extrapolate(unshaded(3))
    np.testing.assert_array_equal(without_it.step(shaded(3)), with_it.step(shaded(3)))


def test_stats_tell_extrapolated_frames_from_shaded_ones(taau: Model) -> None:
    upscaler = make(taau)
    run(upscaler, "suusu")
    stats = upscaler.stats
    assert (stats.frames, stats.extrapolated, stats.resets) == (5, 3, 1)
    assert stats.extrapolation_seconds > 0.0
    assert stats.seconds > 0.0


def test_correct_shaded_and_unshaded_frames_pass_the_checks() -> None:
    scene = LitScene(velocity=(2.0, 1.0), radius=8.0, disc_velocity=(-1.0, 0.5), sky=6.0)
    upscaler = make(shared_model("bilinear"), validate="strict", display_size=(256, 144))
    for index, kind in enumerate("ssuusususs"):
        frame = scene.frame(index, (128, 72), halton_jitter(index, 2.0))
        upscaler.step(frame) if kind == "s" else upscaler.extrapolate(replace(frame, color=None))


def test_checks_read_the_buffers_that_extrapolation_reads(taau: Model) -> None:
    upscaler = make(taau, validate="strict")
    upscaler.step(shaded(0))
    wrong = {**(shaded(1).gbuffer or {}), "base_color": np.full((36, 64, 3), 7.5, np.float32)}
    with pytest.raises(FrameError, match=r"gbuffer\['base_color'\] is outside"):
        upscaler.extrapolate(unshaded(1, gbuffer=wrong))


# --- recordings ---


def test_a_replay_with_another_extrapolation_says_so(taau: Model, tmp_path: Path) -> None:
    file = tmp_path / "a.recording"
    with make(taau, record=file) as upscaler:
        run(upscaler, "su")
    setup = json.loads((file / "recording.json").read_text())
    setup["extrapolation"]["folder"] = "mine"
    (file / "recording.json").write_text(json.dumps(setup))
    with pytest.raises(OSError, match=r"model 'mine' \(guided-warp\), which does not ship.*--extrapolate"):
        Replay(open_recording(file))
    assert Replay(open_recording(file), extrapolation="guided-warp").is_recorded_model
    with make(taau, record=tmp_path / "plain", extrapolation=None) as upscaler:
        upscaler.step(noise(1, SIZE))
    plain = open_recording(tmp_path / "plain")
    assert not Replay(plain, extrapolation="guided-warp").is_recorded_model


_LARGE = """
import resource
import numpy as np
from supersampler import Frame
from supersampler.extrapolation import Extrapolator
h, w = 540, 960
ones = np.full((h, w, 3), 0.5, np.float32)
frame = dict(depth=ones[..., 0], motion=ones[..., :2], jitter=(0.0, 0.0),
             gbuffer={"base_color": ones, "normal": ones})
model = Extrapolator("guided-warp", ["CPUExecutionProvider"], 1)
past = model.after_shaded(Frame(color=ones, **frame))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
color, _ = model.extrapolate(Frame(color=None, **frame), past)
assert np.allclose(color, 0.5, rtol=1e-4)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="counts in kilobytes")
def test_a_frame_of_960x540_takes_less_than_a_gigabyte() -> None:
    assert int(run_apart(_LARGE).stdout) < 800_000


def test_upscalers_share_the_graph_of_an_extrapolation(taau: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def counted(info: ModelInfo, *given: Any) -> Any:
        opened.append(info.method)
        return OnnxExtrapolation(info, *given)

    monkeypatch.setattr(executors, "OnnxExtrapolation", counted)
    first = make(taau, extrapolation="guided-flow")
    with make(taau, extrapolation="guided-flow"):
        assert len(opened) <= 1, "none if another test has it open"
    first.close()
