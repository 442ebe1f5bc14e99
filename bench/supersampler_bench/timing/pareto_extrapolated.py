"""Run time against error of frames that were not shaded: their colour is drawn, and then stepped on.

What a frame that is not shaded saves, it saves where frames are rendered: this is what it costs in its place.
"""

import itertools
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from supersampler.frame import Size
from supersampler.upscaler import Upscaler
from supersampler_bench.compatibility import dressed
from supersampler_bench.quality.extrapolation import EVERY_SECOND
from supersampler_bench.quality.score_record import ratio_of
from supersampler_bench.record import Record, machine_name
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.pareto import METRICS
from supersampler_bench.timing.speed import WARM_UP, frames_of

BENCH = "extrapolation"
SHOWN = ("psnr", "ssim", "flip", "tpsnr")  # the last of all frames


@dataclass(frozen=True)
class Hidden:
    """One upscaler and what draws every second frame for it.

    Attributes:
        upscaler: method, precision and skipping.
        model: that draws.
        ratio: display over render size.
        shaded: median wall time of a step on a shaded frame, milliseconds.
        hidden: the same of one that is drawn, and then stepped on.
        scores: of hidden frames, by the metric's name.
        shaded_psnr: of the same frames, were they shaded.
    """

    upscaler: str
    model: str
    ratio: float
    shaded: float
    hidden: float
    scores: Mapping[str, float]
    shaded_psnr: float


class _Runner:
    """An Upscaler of which every second frame is hidden."""

    def __init__(self, scored: Hidden, display: Size, threads: int) -> None:
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
        frames = (dressed(frame, self._upscaler.gbuffers, display) for frame in frames_of(render))
        self._frames = itertools.cycle([replace(frame, reset=False) for frame in frames])
        self._walls: tuple[list[float], list[float]] = [], []
        for _ in range(WARM_UP):
            self.step(counts=False)

    def step(self, *, counts: bool = True) -> None:
        """Time a frame of either kind."""
        for hidden, walls in enumerate(self._walls):
            frame, began = next(self._frames), time.perf_counter()
            if hidden:
                self._upscaler.extrapolate(replace(frame, color=None))
            else:
                self._upscaler.step(frame)
            if counts:
                walls.append(1e3 * (time.perf_counter() - began))

    def timed(self) -> Hidden:
        """Summarise."""
        shaded, hidden = map(statistics.median, self._walls)
        return replace(self.scored, shaded=shaded, hidden=hidden)


def measure_hidden(records: Sequence[Record], display: Size, *, threads: int, steps: int) -> list[Hidden]:
    """Time all that records have scores of, in turns; the fastest first.

    Args:
        records: of `bench extrapolation --json` or `bench pareto --json`; of others nothing is taken, and of
            what several have, the last.
        display: (width, height) of the pictures that are timed.
        threads: of the processor.
        steps: that count, of each kind of frame.
    """
    scored = [hidden for record in records for hidden in hidden_of(record)]
    latest = {(hidden.upscaler, hidden.model, hidden.ratio): hidden for hidden in scored}
    runners = [_Runner(hidden, display, threads) for hidden in latest.values()]
    for _ in range(steps):
        for runner in runners:
            runner.step()
    return sorted((runner.timed() for runner in runners), key=lambda h: (h.ratio, h.hidden))


def hidden_of(record: Record) -> Iterator[Hidden]:
    """What a record has scores of; of one that timed nothing, without times."""
    if record.get("bench") != BENCH:
        yield from (Hidden(**row) for row in record.get("hidden", ()))
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
                yield Hidden(upscaler, model, mean["ratio"], 0.0, 0.0, found, shaded)


def _of_only_shot(record: Record) -> Iterator[dict[str, Any]]:
    for shot in record["shots"]:
        yield from ({"ratio": ratio_of(shot), **alternation} for alternation in shot["alternations"])


def hidden_rows(measured: Sequence[Hidden]) -> list[dict[str, Any]]:
    """Return all values, ready for JSON."""
    return [asdict(hidden) for hidden in measured]


def hidden_table(record: Record) -> str:
    """Return the table of a Pareto record as Markdown, with its caption; empty where nothing was hidden."""
    measured = list(hidden_of(record))
    if not measured:
        return ""
    metrics = [m for m in METRICS if m.name in SHOWN]
    rows = [
        f"| ratio | upscaler | drawn by | ms shaded | ms hidden | PSNR dB shaded "
        f"| {' | '.join(m.heading for m in metrics)} |",
        f"| ---: | --- | --- | ---: | ---: | ---: | {' | '.join('---:' for _ in metrics)} |",
    ]
    for h in measured:
        cells = [f"{m.scale * h.scores[m.name]:.{m.digits}f}" for m in metrics]
        head = (
            f"{h.ratio:g} | {h.upscaler} | {h.model} | {h.shaded:.1f} | {h.hidden:.1f} | {h.shaded_psnr:.2f}"
        )
        rows.append(f"| {head} | {' | '.join(cells)} |")
    width, height = record["display"]
    caption = (
        f"Every second frame is hidden. Time of a step to {width}x{height} on {record['threads']} threads "
        f"({machine_name(record)}): on a shaded frame, and on a hidden one, with drawing its colour. Scores "
        "are of hidden frames, tPSNR of all; PSNR shaded is what they have where they are shaded."
    )
    return "\n".join([*rows, "", caption])
