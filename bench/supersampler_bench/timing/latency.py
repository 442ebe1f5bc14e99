"""Step times. Settings alternate in one run, because a machine's speed changes from minute to minute."""

import itertools
import os
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from supersampler import Frame, Model, Shot, Upscaler
from supersampler.arguments import AtRest, ExecutorName, Precision
from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Float32, Size
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.specs import compatible, with_default_gbuffers
from supersampler_model.data.rendered import render_size

WARM_UP = 4  # steps of each setting
REFERENCE = "taa"  # on the CPU backend; `Timed.multiple` is relative to it
SLOW = 10.0  # times the reference; slower settings alternate separately, because they leave cold caches


@dataclass(frozen=True)
class Setting:
    """A method at a display size, how it runs, and on how many threads."""

    method: str
    display: Size
    executor: ExecutorName
    threads: int
    precision: Precision = "auto"
    at_rest: AtRest = "converge"


@dataclass(frozen=True)
class Timed:
    """Times of one setting: wall time of a step unless stated otherwise."""

    setting: Setting
    executor: str  # as chosen by "auto"
    precision: str  # as chosen by "auto"
    median: float
    p95: float
    p99: float
    processor: float  # mean CPU time of all cores per step
    multiple: float  # median over REFERENCE's at the same size and threads
    stages: dict[str, float]  # means; empty for the ONNX backend
    resident: int  # bytes by which loading and warm-up grew the process; 0 if unknown
    first: float  # from the model's name to its first image: loading and one step


class _LatencyRunner:
    """A loaded setting, whose steps are timed."""

    def __init__(self, setting: Setting, frames: Sequence[Frame], providers: str, warm_up: int) -> None:
        before, began = _resident(), time.perf_counter()
        self.setting = setting
        self._model = model = Model.load(
            setting.method,
            providers=providers,
            threads=setting.threads,
            executor=setting.executor,
            precision=setting.precision,
        )
        frames = [with_default_gbuffers(frame, model.info.gbuffers, setting.display) for frame in frames]
        self._upscaler = Upscaler(
            model, display_size=setting.display, at_rest=setting.at_rest, validate="off"
        )
        self._image = np.empty((*setting.display[::-1], 3), np.float32)
        self._frames = itertools.cycle([replace(frame, reset=False) for frame in frames])
        self.wall: list[float] = []
        self._processor = 0.0
        self.step(counts=False)
        self._first = 1e3 * (time.perf_counter() - began)
        self.fastest = min(self.step(counts=False) for _ in range(warm_up))
        self._resident = max(_resident() - before, 0)
        self._warm_up = self._upscaler.stats.stages

    def step(self, *, counts: bool = True) -> float:
        """Return the time of one step."""
        frame = next(self._frames)
        began, spent = time.perf_counter(), time.process_time()
        self._upscaler.step(frame, out=self._image)
        wall = 1e3 * (time.perf_counter() - began)
        if counts:
            self.wall.append(wall)
            self._processor += 1e3 * (time.process_time() - spent)
        return wall

    def timed(self, reference: float) -> Timed:
        """Summarise the steps; `reference` is the median of REFERENCE."""
        median, p95, p99 = quantiles(self.wall)
        steps, stages = len(self.wall), self._upscaler.stats.stages
        return Timed(
            setting=self.setting,
            executor=self._model.executor,
            precision=self._model.precision,
            median=median,
            p95=p95,
            p99=p99,
            processor=self._processor / steps,
            multiple=median / reference,
            stages={
                name: 1e3 * (spent - self._warm_up.get(name, 0.0)) / steps for name, spent in stages.items()
            },
            resident=self._resident,
            first=self._first,
        )


def take_turns(
    steps: Sequence[Callable[[], object]], rounds: int, *, on_round: Callable[[], None] = lambda: None
) -> None:
    """Call all steps in turn, `rounds` times."""
    for _ in range(rounds):
        for step in steps:
            step()
        on_round()


def quantiles(milliseconds: Sequence[float]) -> tuple[float, float, float]:
    """Return the median and the 95th and 99th percentiles."""
    p95, p99 = (float(np.quantile(milliseconds, q)) for q in (0.95, 0.99))
    return statistics.median(milliseconds), p95, p99


def measure_latency(
    methods: Sequence[str],
    displays: Sequence[Size],
    executors: Sequence[ExecutorName],
    threads: Sequence[int],
    *,
    providers: str = "cpu",
    ratio: float = 2.0,
    steps: int = 30,
    warm_up: int = WARM_UP,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Timed]:
    """Time all settings; settings of one size and thread count alternate, as in `measure_settings`.

    Executors that a method lacks are left out. `providers` are of ONNX Runtime, see `Model.load`.
    """
    results = []
    for display, count in itertools.product(displays, threads):
        settings = [Setting(m, display, e, count) for m, e in itertools.product(methods, executors)]
        results += measure_settings(
            settings, providers=providers, ratio=ratio, steps=steps, warm_up=warm_up, on_left_out=on_left_out
        )
    return results


def measure_settings(
    settings: Sequence[Setting],
    *,
    ratio: float,
    steps: int,
    providers: str = "cpu",
    warm_up: int = WARM_UP,
    on_left_out: Callable[[str], None],
    on_round: Callable[[], None] = lambda: None,
) -> list[Timed]:
    """Return the times of REFERENCE, then of some settings of one size and thread count.

    REFERENCE and the fast settings alternate, then the slow ones. Each setting has `warm_up` steps after its
    first image, then `steps` that are timed. Settings that a method lacks are left out. Missing G-buffers get
    default values. `on_round` is called 2 x `steps` times.
    """
    display, threads = settings[0].display, settings[0].threads
    frames = plaza_frames(render_size(display, ratio))
    methods = list(dict.fromkeys(s.method for s in settings))
    kept = compatible(methods, frames[0].size, display, on_left_out)
    first = Setting(REFERENCE, display, "cpu", threads)
    runners = [_LatencyRunner(first, frames, providers, warm_up)]
    for setting in settings:
        if setting == first or setting.method not in kept:
            continue
        try:
            runners.append(_LatencyRunner(setting, frames, providers, warm_up))
        except (ArgumentError, DeviceError) as error:  # the method or this machine has no such executor
            on_left_out(f"{setting.method} on {setting.executor} is left out: {error}")
    limit = SLOW * runners[0].fastest
    take_turns([runner.step for runner in runners if runner.fastest <= limit], steps, on_round=on_round)
    take_turns([runner.step for runner in runners if runner.fastest > limit], steps, on_round=on_round)
    reference = statistics.median(runners[0].wall)
    return [runner.timed(reference) for runner in runners]


def plaza_frames(render: Size, first: int = 8, count: int = 8) -> list[Frame]:
    """Return frames of the shipped shot, with its motion and edges, tiled to any render size."""
    rows, columns = (np.arange(side) for side in render[::-1])

    def tiled(image: Any) -> Float32:
        height, width = image.shape[:2]
        return np.ascontiguousarray(image[rows[:, None] % height, columns % width], np.float32)

    frames = (item.frame for item in itertools.islice(Shot.open("plaza"), first, first + count))
    return [
        Frame(
            color=tiled(f.color),
            depth=tiled(f.depth),
            motion=tiled(f.motion),
            jitter=f.jitter,
            exposure=f.exposure or 1.0,
        )
        for f in frames
    ]


def _resident() -> int:
    """Return the bytes of this process in memory; 0 if unknown."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class LatencyRecord(BenchRecord):
    """Times of settings at a ratio."""

    ratio: float
    timed: list[Timed]
    BENCH = "latency"
    TABLES = ("", "summary")

    def table(self) -> str:
        """Return the tables of all settings and of their stages."""
        caption = (
            f"Milliseconds of a step at ratio {self.ratio:g}, from a frame in memory to its image in memory, "
            "on the shipped shot, whose camera moves, tiled to the size. Settings of one size alternate. "
            f"{self.machine_name}. Cores: CPU time of all cores. MiB: growth of the process. First: from the "
            "model's name to its first image."
        )
        headings = ["display", "threads:", "method", "executor", "ms:", "p95:", "p99:", "cores:", "of taa:"]
        headings += ["MiB:", "first:"]
        return f"{table(headings, map(_row, self.timed), caption)}\n\n{_stage_table(self.timed)}"

    def summary_table(self) -> str:
        """Return the table of the largest size and number of threads, which README shows."""
        largest = max((r.setting.display, r.setting.threads) for r in self.timed)
        shown = [r for r in self.timed if (r.setting.display, r.setting.threads) == largest]
        executors = {r.executor for r in shown}
        rows = [
            [
                r.setting.method if len(executors) == 1 else f"{r.setting.method}, {r.executor}",
                *(f"{time:.1f}" for time in (r.median, r.p95, r.p99, r.processor, r.multiple)),
                f"{r.first:.0f}",
            ]
            for r in shown
        ]
        headings = ["method", "ms:", "p95:", "p99:", "ms of all cores:", "of taa:", "first image, ms:"]
        backend = f", {executors.pop()} backend" if len(executors) == 1 else ""
        caption = f"{self.machine_name}{backend}. Of taa: ms, divided by those of `taa`."
        return table(headings, rows, caption)


def _row(r: Timed) -> list[object]:
    return [
        *_subject(r),
        f"{r.executor}, {r.precision}",
        *(f"{time:.1f}" for time in (r.median, r.p95, r.p99, r.processor, r.multiple)),
        f"{r.resident / 2**20:.0f}",
        f"{r.first:.0f}",
    ]


def _stage_table(results: Sequence[Timed]) -> str:
    known = [r for r in results if r.stages]
    names = list(dict.fromkeys(name for r in known for name in r.stages))
    rows = ([*_subject(r), *(f"{r.stages[n]:.1f}" if n in r.stages else "–" for n in names)] for r in known)
    headings = ["display", "threads:", "method", *(f"{name}:" for name in names)]
    return table(headings, rows, "Milliseconds by stage, means.")


def _subject(r: Timed) -> list[object]:
    return [size_text(r.setting.display), r.setting.threads, r.setting.method]
