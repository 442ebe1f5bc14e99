"""Invalid arguments are refused at once, by an error that says what is allowed."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.lib.stride_tricks import as_strided

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Conventions, FrameError, Model, Upscaler, jittered_projection
from supersampler.arguments import MAX_PIXELS, MAX_SIDE, MAX_THREADS
from supersampler.backends.onnx.session import planes_of
from supersampler.conventions import mip_bias, render_size_for
from supersampler.errors import ProviderError
from supersampler.frame import MAX_AOVS
from supersampler.io.shot import open_source

SIZE, DISPLAY = (32, 18), (64, 36)
GOOD = noise(1, SIZE)
TENSORS = {name: planes_of(np.asarray(getattr(GOOD, name))) for name in ("color", "depth", "motion")}
WORDS: dict[str, tuple[Callable[[Any], object], str]] = {
    "executor": (lambda word: Model.load("bilinear", executor=word), "'auto', 'onnx', 'cpu' or 'gpu'"),
    "precision": (lambda word: Model.load("bilinear", precision=word), "'auto', 'fp32', 'fp16' or 'int8'"),
    "validate": (lambda word: Upscaler(scale=2, validate=word), "'off', 'warn' or 'strict'"),
    "preset": (lambda word: Upscaler(scale=2, preset=word), "'fast', 'balanced' or 'high'"),
    "at_rest": (lambda word: Upscaler("taa", scale=2, at_rest=word), "'converge', 'accumulate' or 'off'"),
    "style": (lambda word: mip_bias(2.0, word), "'fsr' or 'log2'"),
    "mode": (lambda word: render_size_for(DISPLAY, word), "'fsr_native_aa', .*'xess_ultra_performance'"),
    "depth": (lambda word: Conventions(depth=word), "'reversed_infinite', .* or 'linear'"),
    "layout": (lambda word: open_source(".", layout=word), "'auto', 'shot', 'render', .*'channels' or 'arm'"),
}


@pytest.mark.parametrize("name", WORDS)
def test_a_misspelt_word_is_answered_with_the_list(name: str) -> None:
    call, listed = WORDS[name]
    for word in ("tpu", "Auto", "", "exact "):
        with pytest.raises(ArgumentError, match=re.escape(f"{name} is {word!r}; want ") + ".*" + listed):
            call(word)


def test_a_misspelt_provider_is_answered_with_the_list() -> None:
    with pytest.raises(ProviderError, match="no execution provider is called 'cdua'; known are cpu, cuda, "):
        Model.load("bilinear", providers=["cdua", "cpu"])
    with pytest.raises(ProviderError, match=r"'migraphx' is not in this installation.*CPUExecutionProvider"):
        Model.load("taau", providers="migraphx")
    with pytest.raises(ArgumentError, match="providers is \\[\\]; want 'auto', a provider's name"):
        Model.load("bilinear", providers=[])
    cpu = "CPUExecutionProvider"
    assert Model.load("bilinear", providers=["cpu", cpu]).providers == [cpu]


@pytest.mark.parametrize("threads", [-1, MAX_THREADS + 1, 10**6, 1.0, True, "2", None, np.array([2])])
def test_impossible_thread_counts_are_refused(threads: Any) -> None:
    with pytest.raises(ArgumentError, match=f"threads is .*; want a whole number from 1 to {MAX_THREADS}"):
        Model.load("taau", threads=threads)


@pytest.mark.parametrize(
    "size", [(1.5, 2), (64.0, 36.0), ("64", "36"), (True, True), "64", {64, 36}, (2**40, 2**40), (0, 4), (4,)]
)
def test_an_invalid_size_is_refused_everywhere(size: Any) -> None:
    model = shared_model("bilinear")
    calls: list[Callable[[], object]] = [
        lambda: Upscaler(model, display_size=size),
        lambda: Upscaler(model, scale=2, render_size=size),
        lambda: Upscaler(model, display_size=DISPLAY).warm_up(size),
        lambda: Upscaler.plan(size, DISPLAY, "bilinear"),
        lambda: model.plan(SIZE, size),
        lambda: model.first_history(size, SIZE),
        lambda: render_size_for(size, 2.0),
        lambda: jittered_projection(np.eye(4), (0.0, 0.0), size),
        lambda: Conventions().converter(display_size=size),
    ]
    for call in calls:
        with pytest.raises(ArgumentError, match=r"size is .*; want \(width, height\)"):
            call()


def test_a_display_is_no_larger_than_kernels_and_graphs_can_count() -> None:
    model = shared_model("bilinear")
    for size in ((MAX_SIDE + 1, 1), (1, MAX_SIDE + 1), (MAX_SIDE, MAX_PIXELS // MAX_SIDE + 1)):
        with pytest.raises(ArgumentError, match=f"at most {MAX_PIXELS} pixels together"):
            Upscaler(model, display_size=size)
    assert Upscaler(model, display_size=(MAX_SIDE, MAX_PIXELS // MAX_SIDE)).display_size
    with pytest.raises(ArgumentError, match=r"display_size is \(40000, 2000\)"):
        Upscaler(model, scale=20, render_size=(2000, 100))
    with pytest.raises(ArgumentError, match=r"display_size is \(64000, 36000\)"):
        Upscaler(model, scale=2000).step(GOOD)  # which has no size before the first frame


def test_a_closed_upscaler_refuses_every_call_but_close() -> None:
    upscaler = Upscaler(shared_model("taau", "onnx"), display_size=DISPLAY)
    upscaler.step(GOOD)
    state = upscaler.save_state()
    upscaler.close()
    upscaler.close()
    calls: list[Callable[[], object]] = [
        lambda: upscaler.step(GOOD),
        lambda: upscaler.extrapolate(replace(GOOD, color=None)),
        lambda: upscaler.step_tensors(TENSORS, jitter=GOOD.jitter),
        upscaler.reset,
        lambda: upscaler.warm_up(SIZE),
        upscaler.save_state,
        lambda: upscaler.load_state(state),
        upscaler.__enter__,
    ]
    for call in calls:
        with pytest.raises(ArgumentError, match="upscaler is closed; want open"):
            call()


def test_an_array_that_was_given_another_shape_since_is_refused() -> None:
    """Kernels read as many values as the frame's size says."""
    motion = np.array(GOOD.motion)
    frame = replace(GOOD, motion=motion)
    motion.resize((4, 4, 2), refcheck=False)
    upscaler = Upscaler(shared_model("taau"), display_size=DISPLAY)
    with pytest.raises(FrameError, match=r"motion is \(4, 4, 2\) float32"):
        upscaler.step(frame)


def test_an_image_is_not_written_over_what_the_step_reads() -> None:
    upscaler = Upscaler(shared_model("taau"), display_size=SIZE)
    both = np.zeros((18, 32, 6), np.float32)
    both[..., 3:] = GOOD.color
    with pytest.raises(ArgumentError, match="out is memory of the frame"):
        upscaler.step(replace(GOOD, color=both[..., 3:]), out=both[..., 2:5])
    rows = np.zeros((19, 32, 3), np.float32)
    for strides in ((12, 12, 4), (380, 12, 4), (384, 4, 4)):
        with pytest.raises(ArgumentError, match="out is overlapping itself; want an array of separate"):
            upscaler.step(GOOD, out=as_strided(rows, (18, 32, 3), strides))
    apart = upscaler.step(replace(GOOD, color=both[..., 3:]), out=both[..., :3])
    np.testing.assert_array_equal(apart, Upscaler(upscaler.model, display_size=SIZE).step(GOOD))


def test_a_history_of_another_model_or_size_is_refused() -> None:
    """Kernels read of it what their own histories have."""
    taau, taa = shared_model("taau"), shared_model("taa")
    history = taau.first_history(DISPLAY, SIZE)
    with pytest.raises(ArgumentError, match=r"history is .*; want a History of this model"):
        taa.run(GOOD, history)
    with pytest.raises(ArgumentError, match=r"history_out is .*; want a History of this model"):
        taau.run(GOOD, history, history_out=taa.first_history(DISPLAY, SIZE))
    with pytest.raises(ArgumentError, match="history_out is history itself"):
        taau.run(GOOD, history, history_out=replace(history))
    with pytest.raises(ArgumentError, match=r"history is .*; want a History of this model"):
        taau.run(GOOD, Model.load("taau", threads=1).first_history(DISPLAY, SIZE))
    history.display_size = (128, 72)
    with pytest.raises(ArgumentError, match="history is changed"):
        taau.run(noise(1, (64, 36)), history)


def test_the_page_about_security_has_the_limits_that_hold() -> None:
    page = (Path(__file__).parents[2] / "docs/security.md").read_text(encoding="utf-8")
    for limit in (
        f"render or display | {MAX_SIDE} pixels a side, 2^26 ({MAX_PIXELS:,}) together",
        f"AOVs of a frame (`aovs`) | {MAX_AOVS} channels",
        f"threads of a model | {MAX_THREADS} |",
    ):
        assert limit in page
