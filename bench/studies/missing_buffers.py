"""What G-buffers of render size give: methods with them, and with display pixels in their place.

python bench/studies/missing_buffers.py test-shots --json bench/results/studies/missing-buffers.json \
    --update docs/results/methods.md
"""

from dataclasses import replace

import typer

from studies.stepper_study import run_study
from supersampler import Upscaler
from supersampler.frame import Size
from supersampler.io.shot import Shot, ShotFrame
from supersampler_bench.cli.options import CACHE, JSON, RATIO, SHOT, UPDATE
from supersampler_bench.quality.measure import StepImage, Stepper, reference_size

METHODS = ("gbuffer-fast", "gbuffer-small")
STUDY = "missing-buffers"


def main(
    shot: SHOT, ratio: RATIO = "2", cache: CACHE = None, json: JSON = None, update: UPDATE = None
) -> None:
    """Measure both ways; frames need references and G-buffers of both sizes."""
    run_study(STUDY, steppers, shot, ratio, cache, json, update)


def steppers(shot: Shot) -> list[Stepper]:
    """Return each method on whole frames, and on frames without G-buffers of render size."""
    display = reference_size(shot)
    return [stepper_of(method, display, whole=whole) for method in METHODS for whole in (True, False)]


def stepper_of(method: str, display: Size, *, whole: bool) -> Stepper:
    """Return one of them."""
    upscaler = Upscaler(method, display_size=display, validate="off")

    def step(item: ShotFrame) -> StepImage:
        return StepImage(upscaler.step(item.frame if whole else replace(item.frame, gbuffer=None)))

    return Stepper(method if whole else f"{method}, display size alone", step, upscaler.gbuffers)


if __name__ == "__main__":
    typer.run(main)
