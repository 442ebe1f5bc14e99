"""Ratios of step times: the installed version over another one, in turns in one run.

The speed of a machine changes from minute to minute by more than versions differ, and the speed of a process
depends on where its memory lies. So in each round a method steps on the same frames in a new process of each
version, one after the other, in alternating order. The result is the median over the rounds of the ratio of
their times, with an interval.
"""

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import product
from math import comb
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias, TypeVar

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.files import replacing
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.compatibility import gbuffers_of, incompatibility, with_default_gbuffers
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_bench.timing.child_process import FIRST_IMAGE, STEPS, Version
from supersampler_bench.timing.latency import frames_of
from supersampler_model.data.shots import render_size

COVERAGE = 0.95
"""Least probability with which the interval of a median contains it."""
FEWEST, FEWEST_FOR_INTERVAL = 10, 6
"""Rounds of steps by default; the fewest rounds that give an interval of `COVERAGE`."""
_WARM_UP = 10  # steps of each process before those that count

STEP_WALL, STEP_CORES = "step, wall", "step, all cores"
FIRST, FIRST_FRESH = "first image", "first image, nothing kept"
"""What is timed: a step; a program from its first line to its first image, with or without cached kernels."""
Pair: TypeAlias = tuple[float, float]
"""Of this version and of the other."""
Versions: TypeAlias = tuple[Version, Version]
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Rounds:
    """How often everything is timed.

    Attributes:
        rounds: rounds of steps.
        steps: steps that count, of each version and method in a round.
        starts: rounds of first images with cached kernels.
        fresh: rounds of first images with an empty kernel cache.
    """

    rounds: int = FEWEST
    steps: int = 10
    starts: int = FEWEST
    fresh: int = 0

    def total(self, settings: int) -> int:
        """Return the rounds of one method at so many sizes and numbers of threads."""
        return settings * self.rounds + self.starts + self.fresh


@dataclass(frozen=True)
class Compared:
    """One time of one method in both versions; medians over the rounds, milliseconds.

    Attributes:
        method: the model's name.
        display: (width, height) of the images.
        threads: on the CPU; 0 for first images, which use the version's default.
        what: `STEP_WALL`, `STEP_CORES`, `FIRST` or `FIRST_FRESH`.
        this: of the installed version.
        other: of the other one.
        median: of the ratios this / other in each round.
        low, high: interval that contains the median with at least `COVERAGE`, of order statistics.
        rounds: (this, other) of each round.
    """

    method: str
    display: Size
    threads: int
    what: str
    this: float
    other: float
    median: float
    low: float
    high: float
    rounds: list[Pair]


def measure_against(
    python: str,
    methods: Sequence[str],
    displays: Sequence[Size],
    threads: Sequence[int],
    *,
    ratio: float = 2.0,
    rounds: Rounds = Rounds(),
    on_round: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, Any], list[Compared]]:
    """Time methods in this version and in another one.

    Args:
        python: interpreter of an environment in which the other version is installed.
        methods: names of models that both have.
        displays: (width, height) of the images.
        threads: numbers of CPU threads.
        ratio: display over render size.
        rounds: how often.
        on_round: called after each round of each method.
        on_left_out: called with what is not timed, and why.

    Returns:
        Facts of the versions "this" and "other", and the times.

    Raises:
        ArgumentError: `python` is no interpreter, has no supersampler, lacks a method, or a process died; or
            rounds are too few for an interval.
    """
    for name, count in asdict(rounds).items():
        if name != "steps" and 0 < count < FEWEST_FOR_INTERVAL:
            want = f"at least {FEWEST_FOR_INTERVAL}, or 0"
            raise ArgumentError(f"--{name}", got=count, want=want, hint="Fewer give no interval.")
    results: list[Compared] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        sides = Version("this", sys.executable, folder / "this"), Version("other", python, folder / "other")
        about = {side.name: side.about for side in reversed(sides)}  # a wrong interpreter fails at once
        for display, count in product(displays, threads):
            render, frames = render_size(display, ratio), folder / "frames.npz"
            able = [method for method in methods if not incompatibility(method, render, display)]
            _write_frames(frames, able, render, display)
            for method in able:
                results += _steps(sides, frames, method, display, count, rounds, on_round)
        for method in methods:
            if reason := _no_first_image(method, render_size(displays[0], ratio), displays[0]):
                on_left_out(reason)
            else:
                results += _first_images(sides, method, displays[0], ratio, rounds, on_round)
    return about, results


def _no_first_image(method: str, render: Size, display: Size) -> str:
    if reason := incompatibility(method, render, display):
        return reason
    info = read_model_info(find_model(method))
    return f"{method}: no first image is timed, as its frames have no G-buffers." if info.gbuffers else ""


def _write_frames(path: Path, methods: Sequence[str], render: Size, display: Size) -> None:
    """Write frames for both sides: each field of all frames, and default G-buffers of the first."""
    frames = frames_of(render)
    arrays = {name: np.stack([getattr(f, name) for f in frames]) for name in ("color", "depth", "motion")}
    arrays["jitter"] = np.array([frame.jitter for frame in frames])
    arrays["exposure"] = np.array([frame.exposure for frame in frames])
    names = gbuffers_of(methods)
    first = with_default_gbuffers(frames[0], names, display)
    for name in names:
        place, array = GBUFFERS[name], GBUFFERS[name].find(first)
        if array is not None:
            arrays[f"{place.group}.{place.key}"] = array
    with replacing(path) as partial:
        np.savez(partial, **arrays)  # type: ignore[arg-type]  # its stub takes the names for other arguments


def _steps(
    sides: Versions,
    frames: Path,
    method: str,
    display: Size,
    threads: int,
    rounds: Rounds,
    on_round: Callable[[], None],
) -> Iterator[Compared]:
    request: dict[str, Any] = {
        "method": method,
        "frames": str(frames),
        "display": display,
        "threads": threads,
    }

    def timed(version: Version) -> Pair:
        seconds = version.run(STEPS, **request, warm_up=_WARM_UP, steps=rounds.steps)
        return 1e3 * median(seconds["wall"]), 1e3 * fmean(seconds["cores"])

    found = _in_rounds(rounds.rounds, sides, timed, on_round)
    for number, what in enumerate((STEP_WALL, STEP_CORES)):
        pairs = [(this[number], other[number]) for this, other in found]
        yield compared(method, display, threads, what, pairs)


def _first_images(
    sides: Versions, method: str, display: Size, ratio: float, rounds: Rounds, on_round: Callable[[], None]
) -> Iterator[Compared]:
    request: dict[str, Any] = {"method": method, "render": render_size(display, ratio), "scale": ratio}

    def kept(version: Version) -> float:
        return 1e3 * float(version.run(FIRST_IMAGE, **request)["seconds"])

    def fresh(version: Version) -> float:
        with TemporaryDirectory() as empty:
            return 1e3 * float(version.run(FIRST_IMAGE, cache=Path(empty), **request)["seconds"])

    if rounds.fresh:
        pairs = _in_rounds(rounds.fresh, sides, fresh, on_round)
        yield compared(method, display, 0, FIRST_FRESH, pairs)
    if rounds.starts:
        for version in sides:
            kept(version)  # fills the kernel caches
        yield compared(method, display, 0, FIRST, _in_rounds(rounds.starts, sides, kept, on_round))


def _in_rounds(
    count: int, sides: tuple[T, T], timed: Callable[[T], R], on_round: Callable[[], None]
) -> list[tuple[R, R]]:
    """Time this version, then the other; in every second round the other first."""
    found = []
    for index in range(count):
        first = index % 2
        results = {side: timed(sides[side]) for side in (first, 1 - first)}
        found.append((results[0], results[1]))
        on_round()
    return found


def compared(method: str, display: Size, threads: int, what: str, rounds: list[Pair]) -> Compared:
    """Summarise all rounds."""
    ratios = [this / other for this, other in rounds]
    low, high = interval(ratios)
    this, other = (median(times) for times in zip(*rounds, strict=True))
    return Compared(method, display, threads, what, this, other, median(ratios), low, high, rounds)


def interval(values: Sequence[float], coverage: float = COVERAGE) -> Pair:
    """Return an interval that contains the median of the distribution behind some samples.

    Its ends are the k-th values from either end, with the largest k for which the median lies between them
    with probability `coverage`, whatever the distribution. 0.95 takes `FEWEST_FOR_INTERVAL` values.
    """
    count, ordered = len(values), sorted(values)
    outside, k = 2.0 * 0.5**count, 0  # the probability that the median is beyond the k-th from either end
    while k + 1 < count // 2 and outside + 2.0 * comb(count, k + 1) * 0.5**count <= 1.0 - coverage:
        k += 1
        outside += 2.0 * comb(count, k) * 0.5**count
    return ordered[k], ordered[-1 - k]


def against_record(
    sides: Mapping[str, Any], results: Sequence[Compared], ratio: float, rounds: Rounds
) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    compared = [asdict(result) for result in results]
    record = {"bench": "against", "ratio": ratio, "sides": dict(sides)}
    return {**record, "taken": asdict(rounds), "compared": compared}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [
        [
            size_text(c.display),
            c.threads or "all",
            c.method,
            c.what,
            f"{c.other:.1f}",
            f"{c.this:.1f}",
            f"{c.median:.3f}",
            f"{c.low:.3f} to {c.high:.3f}",
        ]
        for c in (Compared(**row) for row in record["compared"])
    ]
    taken, sides = Rounds(**record["taken"]), record["sides"]
    caption = (
        f"This version ({_named(sides['this'])}) and another ({_named(sides['other'])}) in turns, "
        f"{taken.rounds} rounds of {taken.steps} steps each at ratio {record['ratio']:g}; "
        "medians over the rounds, and of the ratios in each round, with an interval of order statistics that "
        f"holds the median with at least {COVERAGE:.0%}. {machine_name(record)}."
    )
    headings = ["display", "threads:", "method", "what", "other, ms:", "this, ms:", "this / other:"]
    return table([*headings, "95 % interval"], rows, caption)


def _named(version: Mapping[str, Any]) -> str:
    commit = f", commit {version['commit']}" if version["commit"] else ""
    return f"{version['version']}{commit}, Python {version['python']}"
