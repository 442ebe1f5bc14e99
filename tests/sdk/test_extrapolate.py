"""Unshaded frames through an Upscaler: what they are extrapolated from, and what is refused."""

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alternating import alternate, extrapolated_by_torch
from lit_scene import LitScene
from noise import noise
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
from supersampler.frame import Float32
from supersampler.methods.model_file import extrapolation_names, model_names
from supersampler.recording import StepCall, open_recording
from supersampler.recording.replay import Replay
from supersampler_model.methods.guided_warp import GuidedWarp

SIZE, DISPLAY = (64, 36), (128, 72)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)


@pytest.fixture(scope="module")
def taau() -> Model:
    return Model.load("taau", threads=1, executor="onnx")


def make(model: Model, **options: Any) -> Upscaler:
    settings = {"display_size": DISPLAY, "extrapolation": "guided-warp", "validate": "off"}
    return Upscaler(model, **{**settings, **options})


def shaded(index: int, **overrides: Any) -> Frame:
    return SCENE.frame(index, SIZE, halton_jitter(index, 2.0), **overrides)


def unshaded(index: int, **overrides: Any) -> Frame:
    return shaded(index, color=None, **overrides)


def run(upscaler: Upscaler, pattern: str, start: int = 0) -> list[Float32]:
    return alternate(upscaler, shaded, pattern, start)


def without(frame: Frame, name: str) -> Frame:
    assert frame.gbuffer is not None
    return replace(frame, gbuffer={key: array for key, array in frame.gbuffer.items() if key != name})


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


def test_an_engine_may_use_its_buffers_again(taau: Model) -> None:
    one, other = make(taau), make(taau)
    one.step(shaded(0))
    frame = shaded(0)
    other.step(frame)
    assert frame.color is not None
    assert frame.gbuffer is not None
    for array in (frame.color, frame.depth, frame.motion, *frame.gbuffer.values()):
        array[...] = 0.123
    np.testing.assert_array_equal(one.extrapolate(unshaded(1)), other.extrapolate(unshaded(1)))


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
    result = upscaler.extrapolate(unshaded(1), out=out, outputs=("weight",))
    assert isinstance(result, StepResult)
    assert result.image is out
    assert result.weight is not None


# --- what is refused ---


def refused(upscaler: Upscaler, kind: str) -> None:
    """Hand in a frame that will not do."""
    if kind == "has colour":
        with pytest.raises(FrameError, match=r"frame\.color is \(36, 64, 3\); want None.*`step` takes"):
            upscaler.extrapolate(shaded(2))
    elif kind == "has none":
        with pytest.raises(FrameError, match=r"color is None; want .*'taau' needs shaded.*`extrapolate`"):
            upscaler.step(unshaded(2))
    elif kind == "is first after a cut":
        with pytest.raises(FrameError, match=r"frame\.reset is True on a frame that was not shaded"):
            upscaler.extrapolate(unshaded(2, reset=True))
    elif kind == "lacks a buffer":
        with pytest.raises(FrameError, match=r"gbuffer\['normal'\] is None; want \(36, 64, 3\).*guided-warp"):
            upscaler.extrapolate(without(unshaded(2), "normal"))
    elif kind == "lacks a buffer, shaded":
        with pytest.raises(FrameError, match=r"gbuffer\['base_color'\] is None"):
            upscaler.step(without(shaded(2), "base_color"))
    elif kind == "is too large":
        with pytest.raises(FrameError, match="size"):
            upscaler.extrapolate(SCENE.frame(2, (256, 144), color=None))
    else:
        with pytest.raises(ArgumentError, match="want"):
            upscaler.extrapolate(unshaded(2), outputs=("wait",))


REFUSED = [
    "has colour", "has none", "is first after a cut", "lacks a buffer", "lacks a buffer, shaded",
    "is too large", "asks for what there is not",
]  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize("before", ["ss", "su"])
def test_a_frame_that_is_refused_changes_nothing(taau: Model, kind: str, before: str) -> None:
    one, other = make(taau), make(taau)
    run(one, before), run(other, before)
    refused(other, kind)
    for a, b in zip(run(one, "us", 2), run(other, "us", 2), strict=True):
        np.testing.assert_array_equal(a, b)
    assert other.stats.frames == one.stats.frames == 4


def test_before_any_shaded_frame_and_after_a_reset_there_is_nothing_to_draw_from(taau: Model) -> None:
    upscaler = make(taau)
    for _ in range(2):
        with pytest.raises(FrameError, match=r"None before any shaded frame; want .*shade a frame"):
            upscaler.extrapolate(unshaded(1))
        run(upscaler, "su")
        upscaler.reset()


def test_an_upscaler_without_extrapolation_says_how_to_make_one_with_it(taau: Model) -> None:
    upscaler = make(taau, extrapolation=None)
    upscaler.step(noise(1, SIZE))  # needs no G-buffers
    with pytest.raises(ArgumentError, match=r"extrapolation is None; want a model.*'guided-warp'"):
        upscaler.extrapolate(unshaded(1))


def test_tensors_are_refused_rather_than_forgotten(taau: Model) -> None:
    with pytest.raises(ArgumentError, match="called with extrapolation"):
        make(taau).step_tensors({}, jitter=(0.0, 0.0))


def test_what_extrapolates_is_no_upscaler_and_an_upscaler_does_not_extrapolate(taau: Model) -> None:
    assert extrapolation_names() == ["guided-flow", "guided-warp"]
    assert not set(extrapolation_names()) & set(model_names())
    for use in (
        Model.load,
        lambda name: Upscaler(name, scale=2.0),
        lambda n: Upscaler.plan(SIZE, DISPLAY, n),
    ):
        with pytest.raises(ModelError, match=r"upscales nothing.*Upscaler\(extrapolation='guided-warp'\)"):
            use("guided-warp")
    with pytest.raises(ModelError, match=r"'taau' upscales.*extrapolation takes guided-flow or guided-warp"):
        make(taau, extrapolation="taau")
    with pytest.raises(ModelError, match=r"no model 'guided-wrap'.*guided-warp"):
        make(taau, extrapolation="guided-wrap")


def test_a_closed_one_renders_nothing(taau: Model) -> None:
    upscaler = make(taau)
    upscaler.close()
    with pytest.raises(ArgumentError, match="closed"):
        upscaler.extrapolate(unshaded(1))


# --- sessions ---


@pytest.mark.parametrize("pattern", ["s", "su", "suu"])
def test_a_state_continues_bit_for_bit(taau: Model, pattern: str) -> None:
    one, other = make(taau), make(taau)
    run(one, pattern)
    state = pickle.loads(pickle.dumps(one.save_state()))  # noqa: S301  # of our own
    other.load_state(state)
    for a, b in zip(run(one, "uus", 3), run(other, "uus", 3), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_state_goes_with_and_without_extrapolation(taau: Model) -> None:
    with_it, without_it = make(taau), make(taau, extrapolation=None)
    run(with_it, "su")
    without_it.load_state(with_it.save_state())
    np.testing.assert_array_equal(without_it.step(shaded(2)), with_it.step(shaded(2)))
    with_it.load_state(without_it.save_state())
    with pytest.raises(FrameError, match="before any shaded frame"):
        with_it.extrapolate(unshaded(3))
    np.testing.assert_array_equal(without_it.step(shaded(3)), with_it.step(shaded(3)))


@pytest.mark.parametrize("how", ["missing", "of another size"])
def test_a_state_that_does_not_fit_is_refused_and_changes_nothing(taau: Model, how: str) -> None:
    one, other = make(taau), make(taau)
    run(one, "su"), run(other, "su")
    state = one.save_state()
    assert state.shaded is not None
    wrong = dict(state.shaded)
    if how == "missing":
        del wrong["history.normal"]
    else:
        wrong["history.normal"] = wrong["history.normal"][:, :, 1:]
    with pytest.raises(ArgumentError, match=r"'history\.normal'"):
        other.load_state(replace(state, shaded=wrong))
    np.testing.assert_array_equal(one.extrapolate(unshaded(2)), other.extrapolate(unshaded(2)))


def test_warming_up_leaves_the_history(taau: Model) -> None:
    one, other = make(taau), make(taau, render_size=SIZE)
    other.warm_up()
    with pytest.raises(FrameError, match="before any shaded frame"):
        other.extrapolate(unshaded(1))
    run(one, "s"), run(other, "s")
    other.warm_up()
    np.testing.assert_array_equal(one.extrapolate(unshaded(1)), other.extrapolate(unshaded(1)))


def test_stats_tell_extrapolated_frames_from_shaded_ones(taau: Model) -> None:
    upscaler = make(taau)
    run(upscaler, "suusu")
    stats = upscaler.stats
    assert (stats.frames, stats.extrapolated, stats.resets) == (5, 3, 1)
    assert stats.extrapolation_seconds > 0.0
    assert stats.seconds > 0.0


def test_checks_find_nothing_wrong_with_right_frames_of_either_kind() -> None:
    scene = LitScene(velocity=(2.0, 1.0), radius=8.0, disc_velocity=(-1.0, 0.5), sky=6.0)
    upscaler = make(Model.load("bilinear", threads=1), validate="strict", display_size=(256, 144))
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


def replayed(file: Path) -> tuple[Replay, list[Any]]:
    replay = Replay(open_recording(file))
    return replay, [step for step in map(replay.call, replay.recording) if step is not None]


def test_a_replay_of_both_kinds_of_frames_is_bit_for_bit_what_was_recorded(
    taau: Model, tmp_path: Path
) -> None:
    file, made = tmp_path / "a.recording", list[Float32 | None]()
    with make(taau, record=file) as upscaler:
        made += run(upscaler, "suus")
        state = upscaler.save_state()
        made += run(upscaler, "uu", 4)
        upscaler.load_state(state)
        made += run(upscaler, "us", 4)
        refused(upscaler, "lacks a buffer")
        refused(upscaler, "has colour")
        made += [None, None, *run(upscaler, "u", 6)]
        upscaler.reset()
        with pytest.raises(FrameError):
            upscaler.extrapolate(unshaded(7))
        made += [None, *run(upscaler, "su", 8)]
    replay, steps = replayed(file)
    assert replay.is_recorded_model
    assert [step.exact for step in steps] == [True] * len(made)
    for image, step in zip(made, steps, strict=True):
        np.testing.assert_equal(image, None if step.result is None else step.result.image)
    calls = [call for call in replay.recording if isinstance(call, StepCall)]
    assert [call.name == "extrapolate" for call in calls][:6] == [False, True, True, False, True, True]
    assert all(set(call.frame.gbuffer or {}) <= {"base_color", "normal"} for call in calls)


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
