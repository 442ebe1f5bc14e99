"""One hostile frame is forgotten: thirty frames later the image is the one without it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from gbuffer_method import gbuffers
from supersampler import Frame, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.gbuffers import grouped
from supersampler_bench.stress.compare import VisibleDifference, difference
from supersampler_bench.stress.runner import chosen
from supersampler_bench.stress.scenario import Session, Subject, Trial
from supersampler_bench.stress.scenes import STILL
from supersampler_bench.stress.subjects import subjects
from supersampler_model.data.scenes.analytic import AnalyticScene, DiscOverPlane

DISPLAY, WARM, CLEAN = (32, 24), 10, 30
WITH_KERNELS = ["taa", "taau", "classifier", "classifier+guided-warp"]
WITH_GRAPHS = [*WITH_KERNELS[:3], "gbuffer-small", "gbuffer-small-4x", "extrapolate+guided-warp"]
SUBJECTS = [*((name, "cpu") for name in WITH_KERNELS), *((name, "onnx") for name in WITH_GRAPHS)]


@dataclass(frozen=True)
class Run:
    """A session after some frames, and its images when no frame is hostile."""

    session: Session
    state: Any
    ratio: int
    dressed: bool
    at_rest: bool
    calm: Sequence[Float32]

    def after(self, **changes: Any) -> list[Float32]:
        """Images of the clean frames that follow a frame with these changes."""
        self.session.load_state(self.state)
        self.session.step(replace(self.frame(WARM), **changes))
        return [self.session.step(self.frame(i)) for i in range(WARM + 1, WARM + 1 + CLEAN)]

    def frame(self, index: int) -> Frame:
        return frame_of(index, self.ratio, dressed=self.dressed, at_rest=self.at_rest)


def frame_of(index: int, ratio: int, *, dressed: bool, at_rest: bool) -> Frame:
    """A disc before a panning plane; or wires at rest, maybe with G-buffers of other surfaces."""
    scene: AnalyticScene = STILL if dressed or at_rest else DiscOverPlane()
    render = DISPLAY[0] // ratio, DISPLAY[1] // ratio
    frame = scene.frame(index, render, halton_jitter(index, float(ratio)))
    frame = replace(frame, reset=False, exposure=None)
    if not dressed:
        return frame
    of_render, of_display = grouped(gbuffers(0, render, DISPLAY))
    return replace(frame, gbuffer=of_render, gbuffer_display=of_display)


@cache
def begun(method: str, executor: Any, *, dressed: bool = False, at_rest: bool = False) -> Run:
    subject: Subject = subjects([method], [executor])[0]
    session, ratio = subject.begin(DISPLAY, 1), round(max(2.0, subject.ratios[0]))
    for index in range(WARM):
        session.step(frame_of(index, ratio, dressed=dressed, at_rest=at_rest))
    run = Run(session, session.save_state(), ratio, dressed, at_rest, [])
    return replace(run, calm=run.after())


def left(run: Run, **changes: Any) -> VisibleDifference:
    """Difference of the last image."""
    return difference(run.after(**changes)[-1], run.calm[-1])


@pytest.mark.long  # steps every method for a period
@pytest.mark.parametrize("exposure", [1e30, 1e-40, 1e4])
@pytest.mark.parametrize(("method", "executor"), SUBJECTS)
def test_one_frame_with_an_absurd_exposure_is_forgotten(method: str, executor: str, exposure: float) -> None:
    run = begun(method, executor)
    images = run.after(exposure=exposure)
    soon, late = difference(images[0], run.calm[0]), difference(images[-1], run.calm[-1])
    assert soon.mean < 4.0 / 255.0, "the next image is already sound"
    assert late.mean < (0.1 if executor == "onnx" else 1.0) / 255.0, "chance is more with an int8 network"
    assert late.p999 < (4.0 if executor == "onnx" else 10.0) / 255.0


@pytest.mark.parametrize(("method", "executor"), SUBJECTS)
def test_a_first_frame_with_an_absurd_exposure_is_forgotten(method: str, executor: str) -> None:
    run = begun(method, executor)
    for exposure in (1e30, 1e4):
        assert left(run, reset=True, exposure=exposure).mean < 1.0 / 255.0


@pytest.mark.parametrize("method", ["gbuffer-small", "gbuffer-small-4x"])
def test_a_frame_of_the_brightest_light_leaves_no_scar(method: str) -> None:
    run = begun(method, "onnx", dressed=True)
    color = np.full_like(np.asarray(run.frame(WARM).color), 65504.0)
    late, cut = left(run, color=color), left(run, reset=True)
    assert late.mean < max(1.25 * cut.mean, 0.1 / 255.0)
    assert late.p999 < max(1.25 * cut.p999, 4.0 / 255.0)


LIT = ["taau", "classifier", "classifier-small"]
CHANCE = 1.25
"""Factor over the bound: of slow pixels and of int8 networks what a cut leaves is one sample of chance."""


@pytest.mark.long  # steps every method for two periods
@pytest.mark.parametrize(
    ("scenario", "method", "executor"),
    [
        *product(["brightest light"], [*LIT, "taau+guided-warp"], ["cpu", "onnx"]),
        *product(["bright light"], ["taau", "taau+guided-warp", "classifier"], ["cpu", "onnx"]),
        ("brightest light", "classifier+guided-warp", "cpu"),
        ("brightest light", "extrapolate+guided-warp", "onnx"),
        ("color", "taau", "cpu"),
    ],
)
def test_one_bad_frame_leaves_no_more_than_a_cut(scenario: str, method: str, executor: Any) -> None:
    """The findings of `bench stress` are within their bounds."""
    run = chosen([f"one frame's {scenario}"])[0].run
    for figure in run(Trial(subjects([method], [executor])[0], (48, 32), 0)):
        assert figure.value < CHANCE * figure.bound, figure


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("method", LIT)
def test_the_brightest_light_is_shown_at_once_and_accumulated_later(method: str, executor: str) -> None:
    run = begun(method, executor, at_rest=True)
    run.session.load_state(run.state)
    history: dict[str, Any] = {}
    for index in range(WARM, WARM + 16):
        frame = run.frame(index)
        color = np.array(frame.color)
        color[4:8, 4:8] = 65504.0
        image = run.session.step(replace(frame, color=color))
        assert display_transform(image)[11:13, 11:13].min() > 0.9, "in the middle of the light"
        history = dict(run.session.save_state().history or {})
    left_behind = history["history.color"][0, :, 11:13, 11:13].transpose(1, 2, 0)
    assert display_transform(left_behind).min() > 0.9
    count: Any = history.get("history.samples", history.get("history.state"))
    assert count[0, 0, 11:13, 11:13].min() > 0.05, "it is a history like any other"
