"""Times of several small cameras: in one call of `Upscaler.step_many`, and in one call for each."""

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import median

import numpy as np
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Shot, Upscaler
from supersampler.cli.arguments import size_text
from supersampler.frame import Float32, Size
from supersampler_bench.record import BenchRecord, table
from supersampler_model.data.rendered import render_size

WARM_UP = 10  # rounds that are not timed
PERIOD = 8  # frames of the shipped shot that each view repeats


@dataclass(frozen=True)
class ViewTimes:
    """Times of one method and size. Milliseconds are medians over the rounds."""

    method: str
    display: Size  # of each view's images
    one: float  # milliseconds of a step of one session, which alone has the caches
    each: float  # milliseconds of `step` on each of the views, in turn
    at_once: float  # milliseconds of `step_many` on the views
    ratios: tuple[float, float, float, float, float]
    """`at_once` over the number of views times `one`, of each round: minimum, quartiles, maximum."""


def measure_views(
    methods: Sequence[str],
    displays: Sequence[Size],
    *,
    views: int,
    threads: int,
    ratio: float = 2.0,
    rounds: int = 100,
    on_round: Callable[[], None] = lambda: None,
) -> list[ViewTimes]:
    """Time each method at each size, with `views` cameras, each with its own part of the shipped shot.

    A round steps one session `views` times, then each view, then all at once.
    """
    results = []
    for display, method in itertools.product(displays, methods):
        model = Model.load(method, threads=threads, providers="cpu", executor="cpu")
        frames = itertools.cycle(_frames(views, render_size(display, ratio)))
        sessions = [Upscaler(model, display_size=display, validate="off") for _ in range(1 + 2 * views)]
        one, each, at_once = sessions[0], sessions[1 : 1 + views], sessions[1 + views :]
        images = np.empty((views, *display[::-1], 3), np.float32)
        times = np.empty((rounds, 3))
        for index in range(-WARM_UP, rounds):
            elapsed = _round(one, each, at_once, next(frames), images)
            if index >= 0:
                times[index] = elapsed
                on_round()
        alone, in_turn, together = (median(column) for column in times.T.tolist())
        ratios = np.quantile(times[:, 2] / times[:, 0], (0.0, 0.25, 0.5, 0.75, 1.0))
        results.append(ViewTimes(method, display, alone / views, in_turn, together, tuple(ratios.tolist())))
    return results


def _round(
    one: Upscaler, each: Sequence[Upscaler], at_once: Sequence[Upscaler], frames: list[Frame], images: Float32
) -> NDArray[np.float64]:
    """Return milliseconds of steps of one session, of a step of each view, and of one call for all: (3,)."""
    moments = [time.perf_counter()]
    for frame, image in zip(frames, images, strict=True):
        one.step(frame, out=image)
    moments.append(time.perf_counter())
    for upscaler, frame, image in zip(each, frames, images, strict=True):
        upscaler.step(frame, out=image)
    moments.append(time.perf_counter())
    Upscaler.step_many(at_once, frames, out=images)
    moments.append(time.perf_counter())
    return 1e3 * np.diff(moments)


def _frames(views: int, size: Size) -> list[list[Frame]]:
    """Return frames by time and view: parts of the shipped shot."""
    shot = [item.frame for item in Shot.open("plaza")][PERIOD : 2 * PERIOD]
    (width, height), (w, h) = shot[0].size, size
    if w > width or h > height:
        hint = "Choose a smaller --display-size or a larger --ratio."
        raise ArgumentError("render size", got=size_text(size), want=f"at most {width}x{height}", hint=hint)
    frames = []
    for frame in shot:
        row = []
        for view in range(views):
            x, y = 7 * view % (width - w + 1), 5 * view % (height - h + 1)
            arrays = {name: getattr(frame, name) for name in ("color", "depth", "motion")}
            parts = {name: array[y : y + h, x : x + w].copy() for name, array in arrays.items()}
            row.append(replace(frame, **parts, gbuffer=None, aovs=None, reset=False))
        frames.append(row)
    return frames


@dataclass(frozen=True)
class ViewsRecord(BenchRecord):
    """Times of several cameras in one call, at a ratio."""

    views: int
    threads: int
    ratio: float
    rounds: int
    results: list[ViewTimes]
    BENCH = "views"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = []
        for r in self.results:
            low, first, middle, third, high = (f"{ratio:.2f}" for ratio in r.ratios)
            spread = f"{first} to {third} ({low} to {high})"
            times = [f"{value:.2f}" for value in (self.views * r.one, r.each, r.at_once)]
            rows.append([size_text(r.display), r.method, *times, f"**{middle}**", spread])
        caption = (
            f"{self.views} cameras at ratio {self.ratio:g}, {self.threads} threads; medians of {self.rounds} "
            "rounds, in which the three alternate. Ratio: `step_many` over one session's steps. Spread: "
            f"quartiles, minimum and maximum. {self.machine_name}, {self.provenance.date[:10]}, commit "
            f"{(self.provenance.commit or 'unknown')[:8]}."
        )
        headings = ["size", "method", f"one session, {self.views} steps, ms:", f"{self.views} sessions, ms:"]
        return table([*headings, "step_many, ms:", "ratio:", "spread:"], rows, caption)
