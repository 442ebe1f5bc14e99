"""The options of `taa` (Salvi 2016), changed one at a time, on shots with references.

python bench/studies/taa_options.py test-shots --json bench/results/studies/salvi-options.json \
    --update docs/results/methods.md
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import torch
import typer

from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Size
from supersampler.io.shot import Shot, ShotFrame
from supersampler.methods.taa.spec import TaaConfig
from supersampler_bench.cli.options import (
    CACHE,
    JSON,
    RATIO,
    SHOT,
    counted,
    opened_shots,
    publish,
)
from supersampler_bench.markdown import update_block
from supersampler_bench.quality.measure import StepImage, Stepper, measure_steppers, reference_size
from supersampler_bench.quality.score_table import QualityRecord
from supersampler_bench.quality.scores import MethodRow, ShotRow
from supersampler_model.methods.taa import Taa
from supersampler_model.ops.images import Size as Extent

OPTIONS = {
    "taa": TaaConfig(),
    "20 % new": TaaConfig(alpha=0.2),
    "5 % new": TaaConfig(alpha=0.05),
    "gamma 0.75": TaaConfig(gamma=0.75),
    "gamma 1.5": TaaConfig(gamma=1.5),
    "minimum and maximum alone": TaaConfig(gamma=None),
    "no minimum and maximum": TaaConfig(intersect_extent=False),
    "RGB": TaaConfig(space="rgb"),
    "5x5 window": TaaConfig(window=5),
    "7x7 window": TaaConfig(window=7),
    "clipped to the centre (not his)": TaaConfig(clip="center"),
    "clamped (not his)": TaaConfig(clip="clamp"),
}


def stepper_of(title: str, config: TaaConfig, display: Size) -> Stepper:
    """Return a stepper of `taa` with these options, in torch."""
    method, extent = Taa(config).eval(), Extent(*display)
    history: list[torch.Tensor] = []

    @torch.no_grad()
    def step(item: ShotFrame) -> StepImage:
        nonlocal history
        if item.frame.reset or not history:
            history = method.first_history(extent, Extent(*item.frame.size))
        inputs = frame_inputs(item.frame, extent, method.inputs())
        image, history, _ = method.step(*map(torch.from_numpy, inputs.values()), *history)
        return StepImage(np.ascontiguousarray(image[0].permute(1, 2, 0).numpy()))

    return Stepper(title, step)


def steppers(shot: Shot) -> list[Stepper]:
    """Return steppers of all options for a shot."""
    return [stepper_of(title, config, reference_size(shot)) for title, config in OPTIONS.items()]


class TaaOptionsRecord(QualityRecord):
    """Scores of all options."""

    BENCH = "salvi-options"
    TABLES = ("",)


def main(
    shot: SHOT,
    ratio: RATIO = "2",
    cache: CACHE = None,
    json: JSON = None,
    update: Annotated[Path | None, typer.Option(help="Rewrite the table of this Markdown file.")] = None,
) -> None:
    """Measure every option; frames need references."""
    name, opened = opened_shots(shot, cache, ratio)
    block = f"study salvi-options {name}"
    measured = []
    with counted("frames", sum(len(one) for one, _ in opened)) as advance:
        for one, origin in opened:
            scores = measure_steppers(one, steppers(one), on_frame=advance)
            measured.append(ShotRow.of(one, origin, methods=[MethodRow.of(each) for each in scores]))
    record = TaaOptionsRecord.of(measured)
    publish(record, block, json)
    if update is not None:
        update_block(update, block, record.table())


if __name__ == "__main__":
    typer.run(main)
