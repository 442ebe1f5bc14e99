"""PSNR lost by fp16 and int8 networks at the end of long sequences, against references."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import product
from typing import Any

import numpy as np

from supersampler import Model, Upscaler, halton_jitter
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import display_transform
from supersampler.model import Precision
from supersampler_bench.compatibility import gbuffers_of
from supersampler_bench.quality.metrics import psnr, tpsnr
from supersampler_bench.record import Record
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import make_sequence
from supersampler_model.data.shots import render_size
from supersampler_model.data.specs import SequenceSpec

PRECISIONS: tuple[Precision, ...] = ("fp32", "fp16", "int8")
"""The first is the baseline of the others."""
SCORED = 24  # frames at the end that have references


@dataclass(frozen=True)
class Scored:
    """One method in one precision on one scene, means of the last frames.

    Attributes:
        scene: family of the test shot.
        method: the model's name.
        precision: of what is learned.
        psnr: against the reference, dB.
        tpsnr: of the changes from frame to frame, dB.
    """

    scene: str
    method: str
    precision: str
    psnr: float
    tpsnr: float


class _Runner:
    """One method in one precision."""

    def __init__(self, method: str, precision: Precision, display: Size) -> None:
        model = Model.load(method, providers="cpu", precision=precision)
        self._upscaler = Upscaler(model, display_size=display, skip="exact", validate="off")
        self._before: Float32 | None = None
        self.psnr: list[float] = []
        self.tpsnr: list[float] = []

    def step(self, frame: Frame, truth: Float32 | None, before: Float32 | None) -> None:
        """Step; the frame counts where its reference is known."""
        shown = display_transform(self._upscaler.step(frame), frame.exposure or 1.0)
        if truth is not None:
            self.psnr.append(psnr(shown, truth))
            if before is not None and self._before is not None and not frame.reset:
                self.tpsnr.append(tpsnr(shown, self._before, truth, before))
        self._before = shown


def measure_precision(
    families: Sequence[str],
    methods: Sequence[str],
    display: Size,
    frames: int,
    *,
    ratio: float = 2.0,
    samples: int = 64,
    on_frame: Callable[[], None] = lambda: None,
) -> list[Scored]:
    """Step through each sequence in all precisions, each with its own history.

    Args:
        families: of the test shots, made longer.
        methods: names of models that are learned.
        display: (width, height) of the images.
        frames: of each sequence; the last `SCORED` count.
        ratio: display over render size.
        samples: a pixel of the references.
        on_frame: called after each frame of a scene.
    """
    renderer = Renderer(display, samples=samples)
    results = []
    for family in families:
        runners = dict(_runners(methods, display))
        before: Float32 | None = None
        for frame, truth in _frames(renderer, family, frames, ratio, gbuffers=bool(gbuffers_of(methods))):
            for runner in runners.values():
                runner.step(frame, truth, before)
            before = truth
            on_frame()
        results += [
            Scored(family, m, p, float(np.mean(r.psnr)), float(np.mean(r.tpsnr)))
            for (m, p), r in runners.items()
        ]
    return results


def _runners(methods: Sequence[str], display: Size) -> Iterator[tuple[tuple[str, Precision], _Runner]]:
    for method, precision in product(methods, PRECISIONS):
        with suppress(ArgumentError):  # the method has no such precision
            yield (method, precision), _Runner(method, precision, display)


def _frames(
    renderer: Renderer, family: str, count: int, ratio: float, *, gbuffers: bool
) -> Iterator[tuple[Frame, Float32 | None]]:
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=count))
    size = render_size(renderer.display_size, ratio)
    for index in range(count):
        scene, jitter = sequence.scene(index), halton_jitter(index, ratio)
        frame = rendered_frame(renderer, scene, size, jitter, reset=sequence.cut(index), gbuffers=gbuffers)
        known = index >= count - SCORED
        truth = renderer.reference(scene).color if known else None
        yield frame, None if truth is None else display_transform(truth, scene.camera.exposure)


def precision_record(results: Sequence[Scored], display: Size, frames: int, ratio: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "precision",
        "display": list(display),
        "ratio": ratio,
        "frames": frames,
        "scored": SCORED,
        "results": [asdict(r) for r in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    results = [Scored(**row) for row in record["results"]]
    (width, height), (first, *others) = record["display"], PRECISIONS
    found = {(r.scene, r.method, r.precision): r for r in results}
    pairs = list(dict.fromkeys((r.scene, r.method) for r in results))
    rows = [
        f"| scene | method | PSNR dB, {first} | {' | '.join(others)} "
        f"| tPSNR dB, {first} | {' | '.join(others)} |",
        f"| --- | --- | {' | '.join(['---:'] * (2 + 2 * len(others)))} |",
    ]
    for pair in pairs:
        base, rest = found[(*pair, first)], [found.get((*pair, p)) for p in others]
        psnrs = ["" if r is None else f"{r.psnr - base.psnr:+.2f}" for r in rest]
        tpsnrs = ["" if r is None else f"{r.tpsnr - base.tpsnr:+.2f}" for r in rest]
        rows.append(
            f"| {pair[0]} | {pair[1]} | {base.psnr:.2f} | {' | '.join(psnrs)} "
            f"| {base.tpsnr:.2f} | {' | '.join(tpsnrs)} |"
        )
    caption = (
        f"Images of {width}x{height} at ratio {record['ratio']:g}, the last {record['scored']} of "
        f"{record['frames']} frames, against references; {' and '.join(others)} as what they differ by "
        f"from {first}."
    )
    return "\n".join([*rows, "", caption])
