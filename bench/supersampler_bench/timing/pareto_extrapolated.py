"""Run time against error of unshaded frames, whose colour is extrapolated and then upscaled.

The time is what an unshaded frame costs; its shading is saved in the renderer.
"""

import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from supersampler.frame import Size
from supersampler.upscaler import Upscaler
from supersampler_bench.compatibility import with_default_gbuffers
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.quality.extrapolation import EVERY_SECOND
from supersampler_bench.quality.score_record import rows_by_ratio
from supersampler_bench.quality.score_table import CLIP_COLUMNS
from supersampler_bench.record import Record, machine_name
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.latency import WARM_UP, frames_of, take_turns
from supersampler_model.data.shots import render_size

BENCH = "extrapolation"
COLUMNS = CLIP_COLUMNS[:4]


@dataclass(frozen=True)
class UnshadedPoint:
    """One upscaler and the model that extrapolates every second frame for it.

    Attributes:
        upscaler: method, precision, and what it does at rest.
        model: that extrapolates.
        ratio: display over render size.
        shaded: median wall time of a step on a shaded frame, milliseconds.
        unshaded: the same of an unshaded frame, with its extrapolation.
        scores: of unshaded frames, by the name of a column; tPSNR is of all frames.
        shaded_psnr: of the same frames, were they shaded.
    """

    upscaler: str
    model: str
    ratio: float
    shaded: float
    unshaded: float
    scores: Mapping[str, float]
    shaded_psnr: float


class _Runner:
    """An Upscaler with every second frame unshaded."""

    def __init__(self, scored: UnshadedPoint, display: Size, threads: int) -> None:
        spec = parse_spec(scored.upscaler)
        self.scored = scored
        self._upscaler = Upscaler(
            spec.model,
            display_size=display,
            providers="cpu",
            threads=threads,
            precision=spec.precision,
            at_rest=spec.at_rest,
            extrapolation=scored.model,
            validate="off",
        )
        frames = frames_of(render_size(display, scored.ratio))
        complete = (with_default_gbuffers(frame, self._upscaler.gbuffers, display) for frame in frames)
        self._frames = itertools.cycle([replace(frame, reset=False) for frame in complete])
        self._walls: tuple[list[float], list[float]] = [], []
        take_turns([self], WARM_UP)
        self._walls = [], []

    def step(self) -> None:
        """Time a frame of either kind."""
        for unshaded, walls in enumerate(self._walls):
            frame, began = next(self._frames), time.perf_counter()
            if unshaded:
                self._upscaler.extrapolate(replace(frame, color=None))
            else:
                self._upscaler.step(frame)
            walls.append(1e3 * (time.perf_counter() - began))

    def timed(self) -> UnshadedPoint:
        """Summarise."""
        shaded, unshaded = map(statistics.median, self._walls)
        return replace(self.scored, shaded=shaded, unshaded=unshaded)


def measure_unshaded(
    records: Sequence[Record],
    display: Size,
    *,
    threads: int,
    steps: int,
    on_round: Callable[[], None] = lambda: None,
) -> list[UnshadedPoint]:
    """Time in turns everything that records have scores of; return the fastest first.

    Args:
        records: of `bench extrapolation --json` or `bench pareto --json`; others are ignored. Where several
            have the same scores, the last counts.
        display: (width, height) of the images that are timed.
        threads: on the CPU.
        steps: that count, of each kind of frame.
        on_round: called `steps` times.
    """
    scored = [point for record in records for point in unshaded_points_of(record)]
    latest = {(point.upscaler, point.model, point.ratio): point for point in scored}
    runners = [_Runner(point, display, threads) for point in latest.values()]
    take_turns(runners, steps, on_round=on_round)
    return sorted((runner.timed() for runner in runners), key=lambda p: (p.ratio, p.unshaded))


def unshaded_points_of(record: Record) -> Iterator[UnshadedPoint]:
    """Yield the scores of a record; times are 0 where it has none."""
    if record.get("bench") != BENCH:
        yield from (UnshadedPoint(**row) for row in record.get("unshaded", ()))
        return
    for row in rows_by_ratio(record, "alternations"):
        if row["alternation"] != EVERY_SECOND:
            continue
        scores = {m["method"]: m["summary"]["warm_cropped"] for m in row["methods"]}
        for method, model in itertools.product(scores, record["models"]):
            upscaler, _, way = method.partition(", ")
            if way == model:
                found = {c.name: scores[method][c.name] for c in COLUMNS}
                shaded = scores[f"{upscaler}, shaded"]["psnr"]
                yield UnshadedPoint(upscaler, model, row["ratio"], 0.0, 0.0, found, shaded)


def unshaded_table(record: Record) -> str:
    """Return the table of a Pareto record as Markdown, with its caption; "" without unshaded frames."""
    points = list(unshaded_points_of(record))
    if not points:
        return ""
    rows = []
    for p in points:
        times = [f"{p.shaded:.1f}", f"{p.unshaded:.1f}", f"{p.shaded_psnr:.2f}"]
        rows.append([f"{p.ratio:g}", p.upscaler, p.model, *times, *(c.figure(p.scores) for c in COLUMNS)])
    caption = (
        f"Every second frame is unshaded. Time of a step to {size_text(record['display'])} on "
        f"{record['threads']} threads ({machine_name(record)}): on a shaded frame, and on an unshaded one "
        "with its extrapolation. Scores are of unshaded frames, tPSNR of all; PSNR shaded is of the same "
        "frames, shaded."
    )
    headings = ["ratio:", "upscaler", "extrapolated by", "ms shaded:", "ms unshaded:", "PSNR dB shaded:"]
    return table([*headings, *(f"{c.title}:" for c in COLUMNS)], rows, caption)
