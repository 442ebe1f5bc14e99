"""Time saved by skipping frozen tiles in partly static scenes, and the error of the images."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Literal

import numpy as np

from supersampler import Model, Upscaler, halton_jitter
from supersampler.cli.arguments import size_text
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import display_transform
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.shots.rendering import held_sequence, rendered_frame, rendered_sequence
from supersampler_model.data.rendered import render_size
from supersampler_model.data.renderer.renderer import Renderer

SKIPS = (False, True)
MOVES: tuple[Literal["nothing", "objects", "camera"], ...] = ("nothing", "objects", "camera")
"""Moving parts of a scene. If the camera moves, objects move, too, and nothing is static."""
WARM_UP = 4  # first frames, which are not timed
SCORED = 16  # last frames, after four jitter periods


@dataclass(frozen=True)
class RestTimes:
    """Times of one method in one scene, over the last SCORED frames unless stated otherwise."""

    scene: str  # family of the test shot
    moves: str  # one of MOVES
    method: str
    converged: float  # fraction of the pixels that are frozen
    milliseconds: float  # median of a step with `skip=False`
    first: float  # median time with `skip=True` over that with False, in the first jitter period
    second: float  # as `first`, in the second jitter period
    last: float  # as `first`, in the last frames
    psnr: float  # dB; images are the same with either value of `skip`


class _SkipRunner:
    """A method with one value of `skip`."""

    def __init__(self, method: str, display: Size, *, skip: bool) -> None:
        model = Model.load(method, providers="cpu", executor="cpu")
        self._upscaler = Upscaler(model, display_size=display, skip=skip, validate="off")
        self._image = np.empty((*display[::-1], 3), np.float32)
        self.milliseconds: list[float] = []
        self.converged: list[float] = []
        self.psnr: list[float] = []

    def step(self, frame: Frame, truth: Float32 | None) -> None:
        """Step, and score the frame if it has a reference."""
        began = time.perf_counter()
        self._upscaler.step(frame, out=self._image)
        self.milliseconds.append(1e3 * (time.perf_counter() - began))
        self.converged.append(self._upscaler.stats.converged or 0.0)
        if truth is not None:
            exposure = frame.exposure or 1.0
            shown = display_transform(self._image, exposure)
            self.psnr.append(psnr(shown, display_transform(truth, exposure)))


def measure_skipping(
    families: Sequence[str],
    methods: Sequence[str],
    display: Size,
    *,
    ratio: float = 2.0,
    samples: int = 64,
    on_frame: Callable[[], None] = lambda: None,
) -> list[RestTimes]:
    """Step through scenes of test-shot families for each of MOVES, with and without `skip` alternately.

    Methods run on the CPU backend. References have `samples` samples per pixel.
    """
    renderer = Renderer(display, samples=samples)
    results = []
    for family in families:
        for moves in MOVES:
            runners = {(m, skip): _SkipRunner(m, display, skip=skip) for m in methods for skip in SKIPS}
            for frame, truth in _frames(renderer, family, ratio, moves):
                for runner in runners.values():
                    runner.step(frame, truth)
                on_frame()
            results += [
                _times(family, moves, method, {skip: runners[method, skip] for skip in SKIPS}, ratio)
                for method in methods
            ]
    return results


def _times(
    family: str, moves: str, method: str, runners: Mapping[bool, _SkipRunner], ratio: float
) -> RestTimes:
    period = jitter_phase_count(ratio)
    full, skipped = (runners[skip].milliseconds for skip in SKIPS)
    parts = slice(WARM_UP, period), slice(period, 2 * period), slice(-SCORED, None)
    first, second, last = (median(skipped[part]) / median(full[part]) for part in parts)
    return RestTimes(
        scene=family,
        moves=moves,
        method=method,
        converged=float(np.mean(runners[True].converged[-SCORED:])),
        milliseconds=median(full[-SCORED:]),
        first=first,
        second=second,
        last=last,
        psnr=float(np.mean(runners[True].psnr)),
    )


def frame_count(ratio: float) -> int:
    """Return the number of frames of a scene."""
    return 4 * jitter_phase_count(ratio) + SCORED


def _frames(
    renderer: Renderer, family: str, ratio: float, moves: str
) -> Iterator[tuple[Frame, Float32 | None]]:
    count, size = frame_count(ratio), render_size(renderer.display_size, ratio)
    if moves == "camera":
        yield from rendered_sequence(renderer, family, count, size, references=SCORED)
        return
    held = held_sequence(family, count, time_stands=moves == "nothing")
    truth: Float32 | None = None
    rendered: dict[tuple[float, float], Frame] = {}  # by jitter: static frames repeat
    for index in range(count):
        scene, jitter = held.scene(index), halton_jitter(index, ratio)
        if index >= count - SCORED and (truth is None or moves != "nothing"):
            truth = renderer.reference(scene).color
        if moves != "nothing" or jitter not in rendered:
            rendered[jitter] = rendered_frame(renderer, scene, size, jitter)
        yield rendered[jitter], truth


@dataclass(frozen=True)
class SkipRecord(BenchRecord):
    """Times with and without `skip`, at a display size and ratio."""

    display: Size
    ratio: float
    scenes: list[RestTimes]
    frames: int
    scored: int = SCORED
    BENCH = "skip"

    def table(self) -> str:
        """Return the table of scenes and methods."""
        rows = []
        for r in self.scenes:
            ratios = [f"{ratio:.2f}" for ratio in (r.first, r.second, r.last)]
            frozen = f"{100 * r.converged:.0f} %"
            rows.append(
                [r.scene, r.moves, r.method, f"{r.milliseconds:.1f}", *ratios, frozen, f"{r.psnr:.2f}"]
            )
        caption = (
            f"Images of {size_text(self.display)} at ratio {self.ratio:g}; {self.frames} frames of test "
            "shots, the camera fixed unless it moves. First and second period, at rest: time of a step over "
            "the time with skip=False, in the first and second jitter period and in the last "
            f"{self.scored} frames. Other columns are of the last {self.scored} frames. {self.machine_name}."
        )
        headings = ["scene", "moves", "method", "ms, all tiles:", "first period:", "second period:"]
        return table([*headings, "at rest:", "frozen:", "PSNR dB:"], rows, caption)
