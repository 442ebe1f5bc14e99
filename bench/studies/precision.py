"""Loss of PSNR by half floats and int8 networks at the end of long sequences, against references.

Half floats are those of torch, which rounds as GPUs do; ONNX Runtime's CPU provider mostly does not.

Sequences are rendered here, with OpenGL.
    python bench/studies/precision.py --scenes court --methods classifier --update docs/results/backends.md
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import product
from typing import Annotated, Any

import numpy as np
import typer

from supersampler import Model, Upscaler
from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import display_transform
from supersampler.model import Precision
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    JSON,
    METHODS,
    ONE_RATIO,
    SAMPLES,
    SCENES,
    UPDATE,
    check_page,
    counted,
    listed,
    publish,
)
from supersampler_bench.compatibility import gbuffers_of
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.parity import stepper_of_torch
from supersampler_bench.quality.metrics import psnr, tpsnr
from supersampler_bench.record import Record
from supersampler_bench.shots.rendered_frame import rendered_sequence
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.shots import render_size

PRECISIONS: tuple[Precision, ...] = ("fp32", "fp16", "int8")
"""The others are compared with the first."""
SCORED = 24  # frames at the end that have references


@dataclass(frozen=True)
class Scored:
    """One method in one precision on one scene, means of the last frames.

    Attributes:
        scene: family of the test shot.
        method: the model's name.
        precision: of the network.
        psnr: against the reference, dB.
        tpsnr: of the changes from frame to frame, dB.
    """

    scene: str
    method: str
    precision: str
    psnr: float
    tpsnr: float


class _Runner:
    """Steps one method in one precision and scores its images."""

    def __init__(self, method: str, precision: Precision, render: Size, display: Size) -> None:
        if precision == "fp16":
            self._step = stepper_of_torch(method, render, display, half=True)
        else:
            model = Model.load(method, providers="cpu", precision=precision)
            self._step = Upscaler(model, display_size=display, validate="off").step
        self._before: Float32 | None = None
        self.psnr: list[float] = []
        self.tpsnr: list[float] = []

    def step(self, frame: Frame, truth: Float32 | None, before: Float32 | None) -> None:
        """Step, and score the image where `truth`, the reference after the display transform, is given."""
        shown = display_transform(self._step(frame), frame.exposure or 1.0)
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
        families: names of families of test shots, which are made longer.
        methods: names of models that are learned.
        display: (width, height) of the images.
        frames: number in each sequence; the last `SCORED` are scored.
        ratio: display over render size.
        samples: samples per pixel of the references.
        on_frame: called after each frame of a scene.
    """
    renderer, size = Renderer(display, samples=samples), render_size(display, ratio)
    gbuffers = bool(gbuffers_of(methods))
    results = []
    for family in families:
        runners: dict[tuple[str, Precision], _Runner] = {}
        for method, precision in product(methods, PRECISIONS):
            with suppress(ArgumentError):  # the method has no such precision
                runners[method, precision] = _Runner(method, precision, size, display)
        before: Float32 | None = None
        sequence = rendered_sequence(renderer, family, frames, size, references=SCORED, gbuffers=gbuffers)
        for frame, reference, exposure in sequence:
            truth = None if reference is None else display_transform(reference, exposure)
            for runner in runners.values():
                runner.step(frame, truth, before)
            before = truth
            on_frame()
        for (method, precision), runner in runners.items():
            scores = (float(np.mean(values)) for values in (runner.psnr, runner.tpsnr))
            results.append(Scored(family, method, precision, *scores))
    return results


def precision_record(results: Sequence[Scored], display: Size, frames: int, ratio: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    facts = {"display": list(display), "ratio": ratio, "frames": frames, "scored": SCORED}
    return {"bench": "precision", **facts, "results": [asdict(result) for result in results]}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    results, (first, *others) = [Scored(**row) for row in record["results"]], PRECISIONS
    found = {(r.scene, r.method, r.precision): r for r in results}
    rows = []
    for pair in dict.fromkeys((r.scene, r.method) for r in results):
        base, rest = found[(*pair, first)], [found.get((*pair, precision)) for precision in others]
        psnrs = ["" if r is None else f"{r.psnr - base.psnr:+.2f}" for r in rest]
        tpsnrs = ["" if r is None else f"{r.tpsnr - base.tpsnr:+.2f}" for r in rest]
        rows.append([*pair, f"{base.psnr:.2f}", *psnrs, f"{base.tpsnr:.2f}", *tpsnrs])
    caption = (
        f"Images of {size_text(record['display'])} at ratio {record['ratio']:g}, the last "
        f"{record['scored']} of {record['frames']} frames, against references; {' and '.join(others)} as "
        f"what they differ by from {first}."
    )
    differences = [f"{precision}:" for precision in others]
    headings = ["scene", "method", f"PSNR dB, {first}:", *differences, f"tPSNR dB, {first}:", *differences]
    return table(headings, rows, caption)


def main(
    scenes: SCENES = "machine_hall,market,night_garden,gallery,court",
    methods: METHODS = "classifier,classifier-small",
    display_size: DISPLAY_SIZE = "320x180",
    frames: Annotated[int, typer.Option(min=30, help="Frames of each sequence.")] = 300,
    ratio: ONE_RATIO = 2.0,
    samples: SAMPLES = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure what lower precisions cost at the end of long sequences."""
    tables = {"study precision": markdown_table}
    check_page(update, tables)
    families, size = listed(scenes), parse_size(display_size, "--display-size")
    with counted("frames", len(families) * frames) as advance:
        results = measure_precision(
            families, listed(methods), size, frames, ratio=ratio, samples=samples, on_frame=advance
        )
    publish(precision_record(results, size, frames, ratio), tables, json, update)


if __name__ == "__main__":
    typer.run(main)
