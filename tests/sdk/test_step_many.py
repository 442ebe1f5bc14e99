"""`Upscaler.step_many`: several cameras in one call."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from method_lists import WITH_KERNELS
from noise import noise
from recorded_files import replayed
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Model, Upscaler
from supersampler.arguments import ExecutorName
from supersampler.recording import StepCall, open_recording
from supersampler.recording.recorder import Recorder

SIZES = ((32, 18), (20, 26), (32, 18), (9, 9), (32, 18))


def frames_at(index: int) -> list[Frame]:
    """One frame of each view; views restart at different times, and one is rendered smaller for a while."""
    sizes = [(34, 19) if view == 2 and index == 2 else size for view, size in enumerate(SIZES)]
    return [noise(10 * view + index, size, reset=index == view) for view, size in enumerate(sizes)]


def cameras(model: Model, **options: Any) -> list[Upscaler]:
    options = {"validate": "off", **options}
    return [Upscaler(model, display_size=(2 * w, 2 * h), **options) for w, h in SIZES]


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("method", WITH_KERNELS)
def test_images_are_those_of_separate_sessions(method: str, threads: int, executor: ExecutorName) -> None:
    if (executor, threads) == ("onnx", 3):
        pytest.skip("ONNX Runtime computes one view after another, with any number of threads")
    model = shared_model(method, threads=threads, executor=executor)
    at_once, alone = cameras(model), cameras(model)
    for index in range(4):
        frames = frames_at(index)
        images = Upscaler.step_many(at_once, frames)
        for image, upscaler, frame in zip(images, alone, frames, strict=True):
            np.testing.assert_array_equal(image, upscaler.step(frame))
    for ours, theirs in zip(at_once, alone, strict=True):
        assert (ours.stats.frames, ours.stats.resets) == (theirs.stats.frames, theirs.stats.resets)
        assert ours.stats.seconds > 0.0
        np.testing.assert_equal(ours.save_state().history, theirs.save_state().history)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_aovs_are_those_of_separate_sessions(executor: ExecutorName) -> None:
    model = shared_model("taau", threads=2, executor=executor)
    at_once, alone = cameras(model), cameras(model)
    for index in range(3):
        frames = [replace(frame, aovs=np.asarray(frame.color)) for frame in frames_at(index)]
        results = Upscaler.step_many(at_once, frames, outputs=("aovs",))
        for result, upscaler, frame in zip(results, alone, frames, strict=True):
            np.testing.assert_array_equal(result.aovs, upscaler.step(frame, outputs=("aovs",)).aovs)


def test_images_are_written_to_one_array_of_all_views() -> None:
    model = shared_model("taau")
    views = [Upscaler(model, display_size=(64, 36)) for _ in range(3)]
    frames = [noise(seed) for seed in range(3)]
    out = np.empty((3, 36, 64, 3), np.float32)
    images = Upscaler.step_many(views, frames, out=out)
    assert all(np.shares_memory(image, out[view]) for view, image in enumerate(images))
    for upscaler, frame, image in zip(views, frames, out, strict=True):
        upscaler.reset()
        np.testing.assert_array_equal(upscaler.step(frame), image)
    some = Upscaler.step_many(views, frames, out=[out[0], None, None])
    assert [np.shares_memory(image, out) for image in some] == [True, False, False]


@pytest.mark.parametrize(("view", "other"), [(0, 1), (1, 0)])
def test_an_image_in_memory_of_another_view_is_refused(view: int, other: int) -> None:
    views = [Upscaler(shared_model("taau"), display_size=(64, 36), validate="off") for _ in range(2)]
    memory, frames = np.zeros((36, 128, 3), np.float32), [noise(0), noise(1)]
    out = [memory[:, :64], memory[:, 64:]]  # interleaved, but apart
    Upscaler.step_many(views, frames, out=out)
    with pytest.raises(ArgumentError, match=r"^view 0: out is memory of the image of view 1; want"):
        Upscaler.step_many(views, frames, out=[out[view], out[view][::-1]])
    color = out[view][::2, ::2]
    color[:] = frames[other].color
    frames[other] = replace(frames[other], color=color)
    with pytest.raises(ArgumentError, match=rf"^view {view}: out is memory of the frame of view {other};"):
        Upscaler.step_many(views, frames, out=out)
    assert [upscaler.stats.frames for upscaler in views] == [1, 1]


def test_outputs_are_those_of_a_session_for_each_view() -> None:
    model = shared_model("classifier")
    at_once, alone = cameras(model), cameras(model)
    names = "weight", "class_map", "ids"
    for index in range(3):
        frames = [replace(f, ids=(9.0 * np.asarray(f.color)).astype(np.int32)) for f in frames_at(index)]
        results = Upscaler.step_many(at_once, frames, outputs=names)
        for result, upscaler, frame in zip(results, alone, frames, strict=True):
            expected = upscaler.step(frame, outputs=names)
            for name in ("image", *names):
                np.testing.assert_array_equal(getattr(result, name), getattr(expected, name))


def test_views_step_alone_between_common_calls() -> None:
    model = shared_model("taau", threads=2)
    mixed, alone = cameras(model), cameras(model)
    for index in range(4):
        frames = frames_at(index)
        if index % 2:
            got = [upscaler.step(frame) for upscaler, frame in zip(mixed, frames, strict=True)]
        else:
            got = [*Upscaler.step_many(mixed[:2], frames[:2]), *Upscaler.step_many(mixed[2:], frames[2:])]
        for image, upscaler, frame in zip(got, alone, frames, strict=True):
            np.testing.assert_array_equal(image, upscaler.step(frame))


def test_a_refused_frame_names_its_view_and_changes_no_history() -> None:
    model = shared_model("taau")
    views, alone = cameras(model, validate="strict"), cameras(model)
    for index in range(2):
        good = frames_at(index)
        for _ in range(3):  # the frames of the other views are handed in again: no jitter is repeated
            frames = [*good[:3], replace(good[3], depth=-good[3].depth), good[4]]
            with pytest.raises(FrameError, match=r"^view 3: frame\.depth") as caught:
                Upscaler.step_many(views, frames)
        assert (caught.value.view, caught.value.name) == (3, "depth")
        with pytest.raises(FrameError, match=r"^view 4: "):
            Upscaler.step_many(views, [*good[:4], noise(31, (500, 500))])
        for image, upscaler, frame in zip(Upscaler.step_many(views, good), alone, good, strict=True):
            np.testing.assert_array_equal(image, upscaler.step(frame))


def test_a_frame_that_extrapolation_cannot_read_changes_no_view() -> None:
    model = shared_model("taau")
    options: dict[str, Any] = {"extrapolation": "guided-warp", "validate": "off"}
    views = [Upscaler(model, display_size=(64, 36), **options) for _ in range(2)]
    complete = noise(1, gbuffer=dict.fromkeys(("base_color", "normal"), noise(1).color))
    with pytest.raises(FrameError, match=r"^view 1: frame\.gbuffer\['base_color'\] is None"):
        Upscaler.step_many(views, [complete, noise(1)])
    assert [view.stats.frames for view in views] == [0, 0]


def test_arguments_that_do_not_belong_together_are_refused() -> None:
    model = shared_model("taau")
    views, frames, others = cameras(model), frames_at(0), cameras(shared_model("bicubic"))
    one, five = np.empty((1, 36, 64, 3), np.float32), np.empty((5, 36, 64, 3), np.float32)
    refused: list[tuple[Any, Any, dict[str, Any], str]] = [
        (views, frames[:4], {}, "frames is of length 4; want 5"),
        (views, frames, {"out": list(one)}, "out is of length 1; want 5"),
        (views, frames, {"out": five}, r"view 1: out is .*\(52, 40, 3\)"),
        ([], [], {}, "upscalers is empty"),
        ([*views[:4], views[0]], frames, {}, r"upscalers\[4\] is upscalers\[0\]; want an Upscaler of its"),
        ([views[0], *others[1:]], frames, {}, r"upscalers\[1\] is of another Model"),
        ([views[0], views[1], None], frames[:3], {}, r"upscalers\[2\] is None; want an Upscaler"),
        (views[0], frames, {}, r"upscalers is <.*Upscaler.*>; want a sequence"),
        (views[:1], [None], {}, "view 0: frame is"),
    ]
    for upscalers, given, options, message in refused:
        with pytest.raises(ArgumentError, match=message) as caught:
            Upscaler.step_many(upscalers, given, **options)
        assert caught.value.view == (int(message[5]) if message.startswith("view") else None)
    views[1].close()
    with pytest.raises(ArgumentError, match="view 1: upscaler is closed"):
        Upscaler.step_many(views, frames)


def test_recorded_views_replay_alone(tmp_path: Path) -> None:
    model = Model.load("taau", threads=1)
    views = [Upscaler(model, display_size=(64, 36), record=tmp_path / f"{view}") for view in range(2)]
    for index in range(3):
        frames = [noise(10 * view + index, reset=index == 0) for view in range(2)]
        Upscaler.step_many(views, frames)
        with pytest.raises(FrameError, match="view 1"):
            Upscaler.step_many(views, [frames[0], noise(1, (500, 500))])
    for view, upscaler in enumerate(views):
        upscaler.close()
        assert [step.exact for step in replayed(tmp_path / f"{view}")] == [True] * 3


def test_ctrl_c_while_a_view_is_recorded_removes_no_step_of_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = Model.load("taau", threads=1)
    views = [Upscaler(model, display_size=(64, 36), record=tmp_path / f"{view}") for view in range(2)]
    frames = [[noise(10 * view + index, reset=index == 0) for view in range(2)] for index in range(3)]
    Upscaler.step_many(views, frames[0])
    with monkeypatch.context() as patch:

        def interrupted(*_: Any) -> None:
            patch.undo()
            raise KeyboardInterrupt

        patch.setattr(Recorder, "_write_outcome", interrupted)
        with pytest.raises(KeyboardInterrupt):
            Upscaler.step_many(views, frames[1])
    assert [upscaler.stats.frames for upscaler in views] == [2, 2]
    Upscaler.step_many(views, frames[2])
    for upscaler in views:
        upscaler.close()
    exact = [[step.exact for step in replayed(tmp_path / f"{view}")] for view in range(2)]
    assert exact == [[True, True, True], [True, None, True]]  # the outcome of one step was not recorded


@pytest.mark.parametrize("alone", [True, False])
def test_ctrl_c_at_any_line_advances_and_records_all_views_or_none(alone: bool, tmp_path: Path) -> None:
    model = Model.load("taau", threads=1)
    frames = [noise(10 * view) for view in range(1 if alone else 3)]
    for line in count():
        files = [tmp_path / f"{line}.{view}" for view in range(len(frames))]
        views = [Upscaler(model, display_size=(64, 36), record=file) for file in files]
        step = partial(views[0].step, frames[0]) if alone else partial(Upscaler.step_many, views, frames)
        interrupted = interrupted_at(line, step)
        for upscaler in views:
            upscaler.close()
        made = [upscaler.stats.frames for upscaler in views]
        recorded = [sum(isinstance(call, StepCall) for call in open_recording(file)) for file in files]
        assert made == recorded, line
        assert len({*made}) == 1, line
        if not interrupted:
            break
    assert line > 30


def interrupted_at(line: int, call: Callable[[], object]) -> bool:
    """Raise KeyboardInterrupt at the line-th executed line of upscaler.py; return whether it is reached."""
    lines = count()

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        if not frame.f_code.co_filename.endswith("upscaler.py"):
            return None
        if event == "line" and next(lines) == line:
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False
