"""How long a step takes. Settings take turns in one run: a machine's speed changes from minute to minute."""

import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from supersampler import Frame, Model, Upscaler, shipped_shot
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.model import ExecutorName

WARM_UP = 4  # steps of each setting before any counts
REFERENCE = "taa"  # on the host: what others are a multiple of
COPIED = 1 << 28  # bytes; several times what caches hold


@dataclass(frozen=True)
class Setting:
    """What is timed: a method at a display size, how it runs, and on how many threads."""

    method: str
    display: Size
    executor: ExecutorName
    threads: int


@dataclass(frozen=True)
class Timed:
    """Of one setting; milliseconds.

    Attributes:
        setting: what.
        precision: of what is learned.
        median, p95, p99, least: wall time of a step.
        processor: mean time that all cores together spent on a step.
        multiple: median over that of the host's `taa` at the same size and threads.
    """

    setting: Setting
    precision: str
    median: float
    p95: float
    p99: float
    least: float
    processor: float
    multiple: float


@dataclass(frozen=True)
class Limits:
    """What this machine can do on the threads of a run: bytes copied and products added, per second."""

    threads: int
    copied: float
    multiplied: float


class _Runner:
    """One setting, ready to step."""

    def __init__(self, setting: Setting, frames: Sequence[Frame]) -> None:
        model = Model.load(
            setting.method, providers="cpu", threads=setting.threads, executor=setting.executor
        )
        self.setting, self.precision = setting, model.precision
        self._upscaler = Upscaler(model, display_size=setting.display, validate="off")
        self._image = np.empty((*setting.display[::-1], 3), np.float32)
        self._frames = itertools.cycle(frames)
        self.wall: list[float] = []
        self.processor = 0.0

    def step(self, *, counts: bool = True) -> None:
        """Time one step."""
        frame = replace(next(self._frames), reset=False)
        began, spent = time.perf_counter(), time.process_time()
        self._upscaler.step(frame, out=self._image)
        if counts:
            self.wall.append(1e3 * (time.perf_counter() - began))
            self.processor += 1e3 * (time.process_time() - spent)

    def timed(self, reference: float) -> Timed:
        """Summarise."""
        walls = sorted(self.wall)
        median = statistics.median(walls)
        p95, p99 = (float(np.quantile(walls, share)) for share in (0.95, 0.99))
        processor = self.processor / len(walls)
        return Timed(self.setting, self.precision, median, p95, p99, walls[0], processor, median / reference)


def measure_speed(
    methods: Sequence[str],
    displays: Sequence[Size],
    executors: Sequence[ExecutorName],
    threads: Sequence[int],
    *,
    ratio: float = 2.0,
    steps: int = 30,
    on_step: Callable[[], None] = lambda: None,
) -> list[Timed]:
    """Time all settings; those of one size and number of threads take turns, step by step.

    Args:
        methods: names of shipped models.
        displays: (width, height) of the pictures.
        executors: of those that a method has.
        threads: of the processor.
        ratio: display over render size.
        steps: that count, of each setting.
        on_step: called after each.
    """
    results = []
    for display, count in itertools.product(displays, threads):
        frames = frames_of((round(display[0] / ratio), round(display[1] / ratio)))
        wanted = [Setting(m, display, e, count) for m, e in itertools.product(methods, executors)]
        first = Setting(REFERENCE, display, "host", count)
        runners = [_Runner(first, frames), *_runners([s for s in wanted if s != first], frames)]
        for counts in (*[False] * WARM_UP, *[True] * steps):
            for runner in runners:
                runner.step(counts=counts)
                on_step()
        reference = statistics.median(runners[0].wall)
        results += [runner.timed(reference) for runner in runners if runner.setting in {first, *wanted}]
    return results


def _runners(settings: Sequence[Setting], frames: Sequence[Frame]) -> Iterator[_Runner]:
    for setting in settings:
        try:
            yield _Runner(setting, frames)
        except ArgumentError:  # no kernels for it: the graph alone
            continue


def frames_of(render: Size) -> list[Frame]:
    """Eight frames of the shipped shot, repeated to the size; its motion and edges, at any size."""
    frames = []
    for item in itertools.islice(shipped_shot(), 8, 16):
        frame = item.frame
        fields: dict[str, Any] = {
            name: _tiled(getattr(frame, name), render) for name in ("color", "depth", "motion")
        }
        frames.append(Frame(**fields, jitter=frame.jitter, exposure=frame.exposure or 1.0))
    return frames


def _tiled(image: Any, render: Size) -> Float32:
    h, w = image.shape[:2]
    times = (-(-render[1] // h), -(-render[0] // w), *[1] * (image.ndim - 2))
    return np.ascontiguousarray(np.tile(image, times)[: render[1], : render[0]], np.float32)


def measure_limits(threads: int) -> Limits:
    """Copy memory and multiply matrices, as numpy does, on all cores that it takes."""
    source = np.ones(COPIED // 4, np.float32)
    target = np.empty_like(source)
    copied = _fastest(lambda: np.copyto(target, source))
    matrix = np.ones((1536, 1536), np.float32)
    product = np.empty_like(matrix)
    multiplied = _fastest(lambda: np.matmul(matrix, matrix, out=product))
    return Limits(threads, COPIED / copied, len(matrix) ** 3 / multiplied)


def _fastest(work: Callable[[], object]) -> float:
    times = []
    for _ in range(6):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def speed_record(results: Sequence[Timed], limits: Limits) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {"bench": "speed", "timed": [asdict(r) for r in results], "limits": asdict(limits)}


def markdown_table(results: Sequence[Timed], ratio: float, machine: str) -> str:
    """Return the table as Markdown, with its caption."""
    rows = [
        "| display | threads | method | executor | ms | p95 | least | ms of all cores | of taa |",
        "| --- | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for r in results:
        s = r.setting
        size = f"{s.display[0]}x{s.display[1]}"
        rows.append(
            f"| {size} | {s.threads} | {s.method} | {s.executor}, {r.precision} | {r.median:.1f} "
            f"| {r.p95:.1f} | {r.least:.1f} | {r.processor:.1f} | {r.multiple:.1f} |"
        )
    caption = (
        f"A step at ratio {ratio:g}, frame in memory to picture in memory, on the shipped shot repeated to "
        f"the size; settings of a size take turns. {machine}."
    )
    return "\n".join([*rows, "", caption])
