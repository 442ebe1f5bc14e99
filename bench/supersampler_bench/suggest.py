"""Which setting to use for a shot, a size and a budget of time, by what this machine measures."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.shot import Shot
from supersampler.methods.gbuffers import names_of
from supersampler.methods.model_file import model_names
from supersampler_bench.fitting import gbuffers_of, why_not
from supersampler_bench.pareto import Point, at_ratio
from supersampler_bench.specs import Spec
from supersampler_bench.speed import Setting, measure_settings

FRAMES, STEPS = 24, 48


@dataclass(frozen=True)
class Candidate:
    """A setting, timed on the shot's frames.

    Attributes:
        spec: method, precision and skipping.
        median, p95: wall milliseconds of a step.
        psnr: mean of the test shots, dB, at the measured ratio nearest to the shot's.
        fits: whether p95 is within the budget.
    """

    spec: Spec
    median: float
    p95: float
    psnr: float
    fits: bool


def measure_candidates(
    shot: Shot,
    display: Size,
    budget: float,
    points: Sequence[Point],
    *,
    threads: int = 0,
    steps: int = STEPS,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Candidate]:
    """Time all known settings on the first frames of a shot, in turns; the best first.

    Best is what fits and draws best; then what does not fit, the fastest first.

    Args:
        shot: whose frames are stepped.
        display: (width, height) of the pictures.
        budget: milliseconds that a step may take, in 95 of 100 frames.
        points: of `bench pareto`, whose scores are taken.
        threads: of the processor; 0 takes every core.
        steps: that count, of each setting.
        on_left_out: called with the name of a method that cannot draw the shot so, and why.

    Raises:
        ArgumentError: no method draws at this ratio.
    """
    ratio = max(display[axis] / shot.render_size[axis] for axis in (0, 1))
    known = {p.spec: p.scores["psnr"] for p in at_ratio(points, ratio)}
    there, models = names_of(shot.read_raw(0)), dict.fromkeys(spec.model for spec in known)
    reasons = {model: why_not(model, shot.render_size, display, there) for model in models}
    for reason in filter(None, reasons.values()):
        on_left_out(reason)
    known = {spec: psnr for spec, psnr in known.items() if not reasons[spec.model]}
    nothing = ArgumentError("--display-size", got=f"a ratio of {ratio:.2f}", want="one that a method draws")
    if not known:
        raise nothing
    read = shot.frames(gbuffers=gbuffers_of({spec.model for spec in known}))
    frames = [item.frame for item in itertools.islice(read, FRAMES)]
    settings = {Setting(s.model, display, "auto", threads, s.precision, s.skip): s for s in known}
    timed = measure_settings(list(settings), ratio=ratio, steps=steps, frames=frames)
    found = [
        Candidate(settings[t.setting], t.median, t.p95, known[settings[t.setting]], t.p95 <= budget)
        for t in timed
        if t.setting in settings
    ]
    if not found:
        raise nothing
    return sorted(found, key=lambda c: (not c.fits, -c.psnr if c.fits else c.p95))


def upscale_command(shot: str, display: Size, spec: Spec, threads: int) -> str:
    """Return the command that draws a shot so."""
    words = ["supersampler upscale", shot, "-o out", f"--display-size {display[0]}x{display[1]}"]
    words.append(f"--{'method' if spec.model in model_names() else 'model'} {spec.model}")
    words += [f"--precision {spec.precision}"] * (spec.precision != "auto")
    words += [f"--skip {spec.skip}"] * (spec.skip != "auto")
    words += [f"--threads {threads}"] * bool(threads)
    return " ".join(words)
