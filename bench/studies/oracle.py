"""Oracle: the best possible blend of frame and history, its weight chosen per pixel by the reference.

No method that only chooses this weight does better, so the gap from `taau` to the oracle is the most that a
network can close. The oracle's history is its own output, as with every method.
    python bench/studies/oracle.py test-shots --ratio 2,3
"""

from typing import Annotated

import numpy as np
import torch
import typer
from torch import Tensor

from studies.stepper_study import run_study
from supersampler.backends.onnx.session import frame_inputs, planes_of
from supersampler.frame import Float32, Size
from supersampler.io.shot import Shot, ShotFrame
from supersampler_bench.cli.options import CACHE, JSON, RATIO, SHOT, UPDATE, listed
from supersampler_bench.quality.measure import StepImage, Stepper, reference_size, stepper_of
from supersampler_bench.quality.score_table import Rows, tables_of
from supersampler_bench.quality.score_table import markdown_table as score_table
from supersampler_bench.record import Record
from supersampler_model.methods.classifier.buffers import History
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import cut_to
from supersampler_model.ops.color import bounded, inverse_tone, tone
from supersampler_model.ops.sampling import View
from supersampler_model.ops.size import Size as Extent


class Oracle:
    """Steps through a shot of which every frame has a reference.

    Args:
        display_size: (width, height) of the references.
    """

    def __init__(self, display_size: Size) -> None:
        self._display = Extent(*display_size)
        self._method = Classifier().eval()  # for its gather stage; nothing learned is asked
        self._previous: tuple[History, View] | None = None

    def step(self, item: ShotFrame) -> Float32:
        """Return the best image (H, W, 3), linear RGB; where there is no reference, the warped history."""
        frame, render = item.frame, Extent(*item.frame.size)
        now = View(self._display, render, torch.tensor([frame.jitter], dtype=torch.float32))
        if frame.reset or self._previous is None:
            image, state, classes, surface, _, exposure = self._method.first_history(self._display, render)[
                :6
            ]
            self._previous = History(image, state, classes, surface, exposure), now
        inputs = frame_inputs(frame, self._display, ("color", "depth", "motion"))
        color, depth, motion = map(torch.from_numpy, inputs.values())
        given = torch.tensor([frame.exposure or 0.0], dtype=torch.float32)
        history, view = self._previous
        with torch.no_grad():
            gathered = self._method.gather(color, depth, motion, given, history, now, view)
            planes = gathered.current.frame, gathered.warped.color, gathered.reprojection.on_screen
            present, warped, on_screen = (cut_to(plane, self._display) for plane in planes)
            known = on_screen * (history.exposure.abs() > 0.0)
            toned = warped
            if item.reference is not None:
                toned = tone(torch.from_numpy(planes_of(item.reference)) * gathered.exposure)
            blend = present + known * best_weight(present, warped, toned) * (warped - present)
            image = bounded(inverse_tone(blend) / gathered.exposure)
        self._previous = (
            history._replace(color=image, depth=gathered.surfaces, exposure=gathered.followed),
            now,
        )
        return np.ascontiguousarray(image[0].permute(1, 2, 0).numpy())


def best_weight(present: Tensor, warped: Tensor, truth: Tensor) -> Tensor:
    """Weight of the history, (1, 1, H, W) in [0, 1], of least squared error; all else (1, 3, H, W)."""
    change = warped - present
    along = ((truth - present) * change).sum(dim=1, keepdim=True)
    return (along / (change * change).sum(dim=1, keepdim=True).clamp(min=1e-8)).clamp(0.0, 1.0)


def gap_closed(rows: Rows) -> list[str]:
    """Say how much of the PSNR gap from `taau` to the oracle each better method closes."""
    psnr = {row["method"]: row["summary"]["warm_cropped"]["psnr"] for row in rows}
    start, gap = psnr["taau"], psnr["oracle"] - psnr["taau"]
    return [
        f"Of the gap from taau to the oracle, {name} closes {(value - start) / gap:.0%}."
        for name, value in psnr.items()
        if start < value < psnr["oracle"]
    ]


def markdown_table(record: Record) -> str:
    """Return the tables of a record as Markdown: of the mean at each ratio, or of the only shot."""
    return "\n\n".join(
        "\n".join([score_table(title, rows), "", *gap_closed(rows)]) for title, rows in tables_of(record)
    )


def main(
    shot: SHOT,
    methods: Annotated[
        str, typer.Option(help="Beside `taau` and the oracle, with commas between.")
    ] = "classifier-small,classifier",
    ratio: RATIO = "2",
    cache: CACHE = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare methods with the oracle; every frame needs a reference."""

    def steppers(one: Shot) -> list[Stepper]:
        others = [stepper_of(method, one) for method in ("taau", *listed(methods))]
        return [*others, oracle_stepper(reference_size(one))]

    run_study("oracle", steppers, shot, ratio, cache, json, update, markdown_table)


def oracle_stepper(display_size: Size) -> Stepper:
    """Return the oracle as `measure_steppers` takes it."""
    oracle = Oracle(display_size)
    return Stepper("oracle", lambda item: StepImage(oracle.step(item)))


if __name__ == "__main__":
    typer.run(main)
