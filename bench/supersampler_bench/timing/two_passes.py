"""Time of two passes over frames in memory, against one pass over the same frames."""

import itertools
import statistics
import time
from typing import NamedTuple

from supersampler import Model, upscale_sequence
from supersampler.frame import Size
from supersampler_bench.compatibility import with_default_gbuffers
from supersampler_bench.specs import Spec
from supersampler_bench.timing.latency import frames_of
from supersampler_model.data.shots import render_size

FRAMES, PAIRS, ALL_FRAMES = 192, 5, 32
"""Frames of a run; runs of one pass and of two; frames of the shipped shot, which the runs repeat."""


class PassTimes(NamedTuple):
    """Seconds of the runs of one pass and of two, in turns."""

    frames: int
    one: list[float]
    two: list[float]

    @property
    def ratio(self) -> float:
        """Median ratio of two passes to one, pair by pair."""
        return statistics.median(two / one for one, two in zip(self.one, self.two, strict=True))


def measure_passes(
    spec: Spec,
    display: Size,
    *,
    ratio: float = 2.0,
    threads: int = 0,
    frames: int = FRAMES,
    pairs: int = PAIRS,
) -> PassTimes:
    """Time runs of one pass and of two in turns; the first run of two passes warms up.

    Args:
        spec: the method; its number of passes is not read.
        display: (width, height) of the images.
        ratio: display over render size.
        threads: on the CPU.
        frames: of a run, without cuts: the shipped shot's, tiled to the render size, again and again.
        pairs: runs of each kind.
    """
    model = Model.load(
        spec.model, providers="cpu", threads=threads, precision=spec.precision, executor=spec.executor
    )
    tiled = frames_of(render_size(display, ratio), first=0, count=ALL_FRAMES)
    ring = [with_default_gbuffers(frame, model.info.gbuffers, display) for frame in tiled]

    def seconds(passes: int) -> float:
        given = itertools.islice(itertools.cycle(ring), frames)
        began = time.perf_counter()
        for _ in upscale_sequence(
            given, display_size=display, model=model, passes=passes, at_rest=spec.at_rest, validate="off"
        ):
            pass
        return time.perf_counter() - began

    seconds(2)
    runs = [(seconds(1), seconds(2)) for _ in range(pairs)]
    return PassTimes(frames, [one for one, _ in runs], [two for _, two in runs])
