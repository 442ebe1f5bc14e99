"""Run time against error of unshaded frames: their colour is extrapolated, then upscaled.

This is the cost of an unshaded frame; the renderer saves its shading.
"""

import itertools
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from supersampler.frame import Size
from supersampler.upscaler import Upscaler
from supersampler_bench.compatibility import with_default_gbuffers
from supersampler_bench.quality.extrapolation import EVERY_SECOND
from supersampler_bench.quality.score_record import ratio_of
from supersampler_bench.record import Record, machine_name
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.pareto import METRICS
from supersampler_bench.timing.speed import WARM_UP, frames_of

BENCH = "extrapolation"
SHOWN = ("psnr", "ssim", "flip", "tpsnr")  # the last of all frames


@dataclass(frozen=True)
class UnshadedPoint:
    """One upscaler and the model that extrapolates every second frame for it.

    Attributes:
        upscaler: method, precision and skipping.
        model: that extrapolates.
        ratio: display over render size.
        shaded: median wall time of a step on a shaded frame, milliseconds.
        unshaded: the same of an unshaded frame, which is extrapolated first.
        scores: of unshaded frames, by the metric's name.
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
            skip=spec.skip,
            extrapolation=scored.model,
            validate="off",
        )
        render = round(display[0] / scored.ratio), round(display[1] / scored.ratio)
        frames = (
            with_default_gbuffers(frame, self._upscaler.gbuffers, display) for frame in frames_of(render)
        )
        self._frames = itertools.cycle([replace(frame, reset=False) for frame in frames])
        self._walls: tuple[list[float], list[float]] = [], []
        for _ in range(WARM_UP):
            self.step(counts=False)

    def step(self, *, counts: bool = True) -> None:
        """Time a frame of either kind."""
        for unshaded, walls in enumerate(self._walls):
            frame, began = next(self._frames), time.perf_counter()
            if unshaded:
                self._upscaler.extrapolate(replace(frame, color=None))
            else:
                self._upscaler.step(frame)
            if counts:
                walls.append(1e3 * (time.perf_counter() - began))

    def timed(self) -> UnshadedPoint:
        """Summarise."""
        shaded, unshaded = map(statistics.median, self._walls)
        return replace(self.scored, shaded=shaded, unshaded=unshaded)


def measure_unshaded(
    records: Sequence[Record], display: Size, *, threads: int, steps: int
) -> list[UnshadedPoint]:
    """Time all that records have scores of, in turns; the fastest first.

    Args:
        records: of `bench extrapolation --json` or `bench pareto --json`; of others nothing is taken, and of
            what several have, the last.
        display: (width, height) of the images that are timed.
        threads: of the processor.
        steps: that count, of each kind of frame.
    """
    scored = [unshaded for record in records for unshaded in unshaded_points_of(record)]
    latest = {(unshaded.upscaler, unshaded.model, unshaded.ratio): unshaded for unshaded in scored}
    runners = [_Runner(unshaded, display, threads) for unshaded in latest.values()]
    for _ in range(steps):
        for runner in runners:
            runner.step()
    return sorted((runner.timed() for runner in runners), key=lambda h: (h.ratio, h.unshaded))


def unshaded_points_of(record: Record) -> Iterator[UnshadedPoint]:
    """What a record has scores of; of one that timed nothing, without times."""
    if record.get("bench") != BENCH:
        yield from (UnshadedPoint(**row) for row in record.get("unshaded", ()))
        return
    for mean in record["means"] or _of_only_shot(record):
        if mean["alternation"] != EVERY_SECOND:
            continue
        scores = {m["method"]: m["summary"]["warm_cropped"] for m in mean["methods"]}
        for method, model in itertools.product(scores, record["models"]):
            upscaler, _, way = method.partition(", ")
            if way == model:
                found = {name: scores[method][name] for name in SHOWN}
                shaded = scores[f"{upscaler}, shaded"]["psnr"]
                yield UnshadedPoint(upscaler, model, mean["ratio"], 0.0, 0.0, found, shaded)


def _of_only_shot(record: Record) -> Iterator[dict[str, Any]]:
    for shot in record["shots"]:
        yield from ({"ratio": ratio_of(shot), **alternation} for alternation in shot["alternations"])


def unshaded_rows(measured: Sequence[UnshadedPoint]) -> list[dict[str, Any]]:
    """Return all values, ready for JSON."""
    return [asdict(unshaded) for unshaded in measured]


def unshaded_table(record: Record) -> str:
    """Return the table of a Pareto record as Markdown, with its caption; "" without unshaded frames."""
    measured = list(unshaded_points_of(record))
    if not measured:
        return ""
    metrics = [m for m in METRICS if m.name in SHOWN]
    rows = [
        f"| ratio | upscaler | extrapolated by | ms shaded | ms unshaded | PSNR dB shaded "
        f"| {' | '.join(m.heading for m in metrics)} |",
        f"| ---: | --- | --- | ---: | ---: | ---: | {' | '.join('---:' for _ in metrics)} |",
    ]
    for h in measured:
        cells = [f"{m.scale * h.scores[m.name]:.{m.digits}f}" for m in metrics]
        times = f"{h.shaded:.1f} | {h.unshaded:.1f} | {h.shaded_psnr:.2f}"
        rows.append(f"| {h.ratio:g} | {h.upscaler} | {h.model} | {times} | {' | '.join(cells)} |")
    width, height = record["display"]
    caption = (
        f"Every second frame is unshaded. Time of a step to {width}x{height} on {record['threads']} threads "
        f"({machine_name(record)}): on a shaded frame, and on an unshaded one with its extrapolation. Scores "
        "are of unshaded frames, tPSNR of all; PSNR shaded is of the same frames, shaded."
    )
    return "\n".join([*rows, "", caption])
