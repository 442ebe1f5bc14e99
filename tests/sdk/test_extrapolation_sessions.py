"""Sessions with unshaded frames, whatever extrapolates: states, buffers, refused frames, recordings."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from alternating import Frames
from flow_method import Shadow
from joint_folder import joint_folder
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Upscaler
from supersampler.frame import Float32
from supersampler.recording import StepCall, open_recording
from supersampler.recording.replay import Replay

SIZE, DISPLAY = (64, 36), (128, 72)
SCENE = Shadow(2.0, velocity=(1.3, -0.6))
shaded = Frames(SCENE, SIZE)
unshaded, run = shaded.unshaded, shaded.run
MADE = ["guided-warp", "guided-flow", "a graph of its own"]
"""The extrapolation model; or the model has a graph of its own for the colours of guided-warp."""

Make = Callable[..., Upscaler]


@pytest.fixture(scope="module")
def joint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return joint_folder(tmp_path_factory.mktemp("models") / "joint")


@pytest.fixture(params=MADE)
def make(request: pytest.FixtureRequest, joint: Path) -> Make:
    own = request.param == MADE[-1]
    model = shared_model(str(joint), providers="cpu") if own else shared_model("taau", "onnx")
    name = MADE[0] if own else request.param
    return lambda **options: Upscaler(
        model, display_size=DISPLAY, extrapolation=name, validate="off", **options
    )


def assert_same(one: Upscaler, other: Upscaler, pattern: str, start: int) -> None:
    """Both must continue with the same images."""
    for a, b in zip(run(one, pattern, start), run(other, pattern, start), strict=True):
        np.testing.assert_array_equal(a, b)


def without(frame: Frame, name: str) -> Frame:
    assert frame.gbuffer is not None
    return replace(frame, gbuffer={key: array for key, array in frame.gbuffer.items() if key != name})


REFUSED: dict[str, tuple[Callable[[Upscaler], object], str]] = {
    "has colour": (lambda u: u.extrapolate(shaded(2)), r"color is \(36, 64, 3\); want None.*`step` takes"),
    "has none": (lambda u: u.step(unshaded(2)), r"color is None; want .* needs shaded.*`extrapolate`"),
    "is first after a cut": (
        lambda u: u.extrapolate(unshaded(2, reset=True)),
        r"frame\.reset is True on a frame that was not shaded",
    ),
    "lacks a buffer": (
        lambda u: u.extrapolate(without(unshaded(2), "normal")),
        r"gbuffer\['normal'\] is None; want \(36, 64, 3\)",
    ),
    "lacks a buffer, shaded": (
        lambda u: u.step(without(shaded(2), "base_color")),
        r"gbuffer\['base_color'\] is None",
    ),
    "is too large": (lambda u: u.extrapolate(shaded(2, (256, 144), color=None)), "size"),
    "asks for what there is not": (lambda u: u.extrapolate(unshaded(2), outputs=("wait",)), "want"),
}


def refused(upscaler: Upscaler, kind: str) -> None:
    """Pass an invalid frame."""
    call, message = REFUSED[kind]
    with pytest.raises((FrameError, ArgumentError), match=message):
        call(upscaler)


@pytest.mark.parametrize("kind", REFUSED)
@pytest.mark.parametrize("before", ["ss", "su"])
def test_a_refused_frame_changes_nothing(make: Make, kind: str, before: str) -> None:
    one, other = make(), make()
    run(one, before), run(other, before)
    refused(other, kind)
    assert_same(one, other, "us", 2)
    assert other.stats.frames == one.stats.frames == 4


def test_before_any_shaded_frame_and_after_a_reset_there_is_nothing_to_draw_from(make: Make) -> None:
    upscaler = make()
    for _ in range(2):
        with pytest.raises(FrameError, match=r"None before any shaded frame; want .*a shaded frame first"):
            upscaler.extrapolate(unshaded(1))
        run(upscaler, "su")
        upscaler.reset()


def test_a_cut_and_a_reset_forget_all_shaded_frames(make: Make) -> None:
    cut, reset, fresh = make(), make(), make()
    run(cut, "susu"), run(reset, "susu")
    reset.reset()
    images = []
    for upscaler, first in ((cut, True), (reset, False), (fresh, False)):
        upscaler.step(shaded(2, reset=first))
        images.append(upscaler.extrapolate(unshaded(3)))
    for image in images[:2]:
        np.testing.assert_array_equal(image, images[2])


def test_an_engine_may_use_its_buffers_again(make: Make) -> None:
    one, other = make(), make()
    for index in (0, 1):
        one.step(shaded(index))
        reused: Any = shaded(index)
        other.step(reused)
        for array in (reused.color, reused.depth, reused.motion, *reused.gbuffer.values()):
            array[...] = 0.123
    assert_same(one, other, "u", 2)


@pytest.mark.parametrize("pattern", ["s", "su", "suu", "sus", "susu"])
def test_a_state_continues_bit_for_bit(make: Make, pattern: str) -> None:
    one, other = make(), make()
    run(one, pattern)
    other.load_state(pickle.loads(pickle.dumps(one.save_state())))  # noqa: S301  # of our own
    assert_same(one, other, "uusu", 4)


def test_warming_up_leaves_the_history(make: Make) -> None:
    one, other = make(), make(render_size=SIZE)
    other.warm_up()
    with pytest.raises(FrameError, match="before any shaded frame"):
        other.extrapolate(unshaded(1))
    run(one, "s"), run(other, "s")
    other.warm_up()
    assert_same(one, other, "u", 1)


def test_a_replay_of_both_kinds_of_frames_is_bit_for_bit(make: Make, joint: Path, tmp_path: Path) -> None:
    file, made = tmp_path / "a.recording", list[Float32 | None]()
    with make(record=file) as upscaler:
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
        own = upscaler.model.info.folder == joint
    replay = Replay(open_recording(file), model=joint if own else None)
    steps = [step for step in map(replay.call, replay.recording) if step is not None]
    assert replay.is_recorded_model
    assert [step.exact for step in steps] == [True] * len(made)
    for image, step in zip(made, steps, strict=True):
        np.testing.assert_equal(image, None if step.result is None else step.result.image)
    calls = [call for call in replay.recording if isinstance(call, StepCall)]
    assert [call.name == "extrapolate" for call in calls][:6] == [False, True, True, False, True, True]
    assert all(set(call.frame.gbuffer or {}) <= {"base_color", "normal", "roughness"} for call in calls)
