"""Step times. Settings take turns in one run, as a machine's speed changes from minute to minute."""

import itertools
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from supersampler import Frame, Model, Shot, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.model import ExecutorName, Precision, Skip
from supersampler_bench.compatibility import incompatibility, with_default_gbuffers
from supersampler_bench.record import Record, machine_name

WARM_UP = 4  # steps of each setting before any counts
REFERENCE = "taa"  # on the CPU backend: what others are a multiple of
SLOW = 10.0  # times the reference: such steps leave cold caches to those that they take turns with
COPIED = 1 << 28  # bytes; several times what caches hold


@dataclass(frozen=True)
class Setting:
    """What is timed: a method at a display size, how it runs, and on how many threads."""

    method: str
    display: Size
    executor: ExecutorName
    threads: int
    precision: Precision = "auto"
    skip: Skip = "exact"


@dataclass(frozen=True)
class Timed:
    """Of one setting; milliseconds.

    Attributes:
        setting: what.
        executor: that it came to.
        precision: of what is learned that it came to.
        median, p95, p99, least: wall time of a step.
        processor: mean time that all cores together spent on a step.
        multiple: median over that of `taa` on the CPU backend at the same size and threads.
        stages: mean wall time by stage; empty for the ONNX backend.
        moved: bytes that a step must move: the frame, the history before and after, the image.
        multiply_adds: of what is learned.
        resident: bytes by which the process grew while the setting was made and warmed up; 0 where the system
            does not say.
    """

    setting: Setting
    executor: str
    precision: str
    median: float
    p95: float
    p99: float
    least: float
    processor: float
    multiple: float
    stages: dict[str, float]
    moved: int
    multiply_adds: int
    resident: int


@dataclass(frozen=True)
class Limits:
    """What this machine can do a second, as numpy does it: bytes moved in a copy, products added."""

    moved: float
    multiplied: float


class _Runner:
    """One setting, ready to step."""

    def __init__(self, setting: Setting, frames: Sequence[Frame]) -> None:
        before = _resident()
        model = Model.load(
            setting.method,
            providers="cpu",
            threads=setting.threads,
            executor=setting.executor,
            precision=setting.precision,
        )
        frames = [with_default_gbuffers(frame, model.info.gbuffers, setting.display) for frame in frames]
        self.setting, self._model = setting, model
        self._upscaler = Upscaler(model, display_size=setting.display, skip=setting.skip, validate="off")
        self._image = np.empty((*setting.display[::-1], 3), np.float32)
        self._frames = itertools.cycle(frames)
        self._plan = model.plan(frames[0].size, setting.display)
        first = frames[0]
        gbuffers = [GBUFFERS[name].find(first) for name in model.info.gbuffers]
        images = (first.color, first.depth, first.motion, *gbuffers)
        self._moved = sum(image.nbytes for image in images if image is not None)
        self.wall: list[float] = []
        self.processor = 0.0
        self.least = min(self.step(counts=False) for _ in range(WARM_UP))
        self._resident = max(_resident() - before, 0)
        self._seconds = model.note_stages()

    def step(self, *, counts: bool = True) -> float:
        """Time one step; returns its milliseconds."""
        frame = replace(next(self._frames), reset=False)
        began, spent = time.perf_counter(), time.process_time()
        self._upscaler.step(frame, out=self._image)
        wall = 1e3 * (time.perf_counter() - began)
        if counts:
            self.wall.append(wall)
            self.processor += 1e3 * (time.process_time() - spent)
        return wall

    def timed(self, reference: float) -> Timed:
        """Summarise."""
        walls = sorted(self.wall)
        median = statistics.median(walls)
        p95, p99 = (float(np.quantile(walls, share)) for share in (0.95, 0.99))
        return Timed(
            setting=self.setting,
            executor=self._model.executor,
            precision=self._model.precision,
            median=median,
            p95=p95,
            p99=p99,
            least=walls[0],
            processor=self.processor / len(walls),
            multiple=median / reference,
            stages={name: 1e3 * spent / len(walls) for name, spent in self._seconds.items()},
            moved=self._moved + self._plan.history_bytes + self._image.nbytes,
            multiply_adds=self._plan.multiply_adds,
            resident=self._resident,
        )


def measure_speed(
    methods: Sequence[str],
    displays: Sequence[Size],
    executors: Sequence[ExecutorName],
    threads: Sequence[int],
    *,
    precisions: Sequence[Precision] = ("auto",),
    skips: Sequence[Skip] = ("exact",),
    ratio: float = 2.0,
    steps: int = 30,
    on_step: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Timed]:
    """Time all settings; those of one size and number of threads take turns, step by step.

    Args:
        methods: names of shipped models.
        displays: (width, height) of the images.
        executors: of those that a method has.
        threads: of the processor.
        precisions: of those that an executor has.
        skips: see `Upscaler`.
        ratio: display over render size.
        steps: that count, of each setting.
        on_step: called after each.
        on_left_out: called with the name of a method that does not run so, and why.
    """
    results = []
    for display, count in itertools.product(displays, threads):
        kinds = itertools.product(methods, executors, precisions, skips)
        wanted = [Setting(m, display, e, count, p, s) for m, e, p, s in kinds]
        results += measure_settings(
            wanted, ratio=ratio, steps=steps, on_step=on_step, on_left_out=on_left_out
        )
    return results


def measure_settings(
    settings: Sequence[Setting],
    *,
    ratio: float,
    steps: int,
    frames: Sequence[Frame] | None = None,
    on_step: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Timed]:
    """Time settings of one size and number of threads, and `REFERENCE`, in turns; the slow after the fast.

    Args:
        settings: those that a method does not have are left out. G-buffers that it reads and `frames` lack
            are made up.
        ratio: display over render size.
        steps: that count, of each.
        frames: that are stepped, again and again; the shipped shot, repeated to the size, where None.
        on_step: called after each.
        on_left_out: called with the name of a method that does not run so, and why.

    Returns:
        The reference first.
    """
    display, threads = settings[0].display, settings[0].threads
    if frames is None:
        frames = frames_of((round(display[0] / ratio), round(display[1] / ratio)))
    first = Setting(REFERENCE, display, "cpu", threads)
    reasons = {s.method: incompatibility(s.method, frames[0].size, display) for s in settings}
    for reason in filter(None, reasons.values()):
        on_left_out(reason)
    others = [s for s in settings if s != first and not reasons[s.method]]
    runners = [_Runner(first, frames), *_runners(others, frames)]
    slow = [runner for runner in runners if runner.least > SLOW * runners[0].least]
    for turn in ([runner for runner in runners if runner not in slow], slow):
        for _ in range(steps):
            for runner in turn:
                runner.step()
                on_step()
    reference = statistics.median(runners[0].wall)
    return [runner.timed(reference) for runner in runners]


def _runners(settings: Sequence[Setting], frames: Sequence[Frame]) -> Iterator[_Runner]:
    for setting in settings:
        try:
            yield _Runner(setting, frames)
        except ArgumentError:  # the method has no such executor or precision
            continue


def frames_of(render: Size, first: int = 8, count: int = 8) -> list[Frame]:
    """Frames of the shipped shot, repeated to the size; its motion and edges, at any size."""
    frames = []
    for item in itertools.islice(Shot.open("plaza"), first, first + count):
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


def measure_limits() -> Limits:
    """Copy memory and multiply matrices on all cores: a copy on two threads, a product on what BLAS takes."""
    source = np.ones(COPIED // 4, np.float32)
    target = np.empty_like(source)
    cores = os.cpu_count() or 1
    parts = list(zip(np.array_split(target, cores), np.array_split(source, cores), strict=True))
    with ThreadPoolExecutor(cores) as pool:
        copied = _fastest(lambda: list(pool.map(lambda part: np.copyto(*part), parts)))
    matrix = np.ones((1536, 1536), np.float32)
    product = np.empty_like(matrix)
    multiplied = _fastest(lambda: np.matmul(matrix, matrix, out=product))
    return Limits(2 * COPIED / copied, len(matrix) ** 3 / multiplied)


def _fastest(work: Callable[[], object]) -> float:
    times = []
    for _ in range(6):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def _resident() -> int:
    """Bytes of this process in memory; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGE_SIZE")


def speed_record(results: Sequence[Timed], limits: Limits, ratio: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "speed",
        "ratio": ratio,
        "timed": [asdict(r) for r in results],
        "limits": asdict(limits),
    }


def timed_of(record: Record) -> list[Timed]:
    """Return what `speed_record` was made of."""
    return [Timed(**{**row, "setting": Setting(**row["setting"])}) for row in record["timed"]]


def markdown_table(record: Record) -> str:
    """Return the tables of a record as Markdown, with their captions."""
    results, limits = timed_of(record), Limits(**record["limits"])
    rows = [
        "| display | threads | method | executor | ms | p95 | p99 | cores | of taa | memory | G/s | MiB |",
        "| --- | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    for r in results:
        seconds = 1e-3 * r.median
        learned = f"{1e-9 * r.multiply_adds / seconds:.0f}" if r.multiply_adds else "–"
        rows.append(
            f"| {_size(r)} | {r.setting.threads} | {r.setting.method} | {_runs(r)} "
            f"| {r.median:.1f} | {r.p95:.1f} | {r.p99:.1f} | {r.processor:.1f} | {r.multiple:.1f} "
            f"| {r.moved / limits.moved / seconds:.0%} | {learned} | {r.resident / 2**20:.0f} |"
        )
    caption = (
        f"A step at ratio {record['ratio']:g}, from frame in memory to image in memory, on the shipped shot, "
        f"whose camera moves, repeated to the size; settings of a size take turns. {machine_name(record)}. "
        "Cores: milliseconds of all together. Memory: share of the step in which frame, history and image "
        f"could be moved, at the {1e-9 * limits.moved:.1f} GB/s of a copy on all cores. G/s: multiply-adds "
        "of the network over the time of the whole step; a product of matrices in single precision reaches "
        f"{1e-9 * limits.multiplied:.0f}. MiB: what the process grew by."
    )
    return "\n".join([*rows, "", caption, "", *_stage_rows(results)])


def _stage_rows(results: Sequence[Timed]) -> list[str]:
    """Table of what the stages of each step take."""
    known = [r for r in results if r.stages]
    names = list(dict.fromkeys(name for r in known for name in r.stages))
    return [
        f"| display | threads | method | {' | '.join(names)} |",
        f"| --- | ---: | --- | {' | '.join('---:' for _ in names)} |",
        *(
            f"| {_size(r)} | {r.setting.threads} | {r.setting.method} | "
            f"{' | '.join(f'{r.stages[n]:.1f}' if n in r.stages else '–' for n in names)} |"
            for r in known
        ),
        "",
        "Milliseconds by stage, means.",
    ]


def _runs(result: Timed) -> str:
    skip = result.setting.skip
    return f"{result.executor}, {result.precision}" + ("" if skip == "exact" else f", skip {skip}")


def _size(result: Timed) -> str:
    return f"{result.setting.display[0]}x{result.setting.display[1]}"
