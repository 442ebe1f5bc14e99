"""Every method renders its golden image in every backend that it has, to within rounding.

`python tests/test_golden.py` renders them anew: look at them, then commit.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from method_backends import BACKENDS
from shared_models import shared_model
from supersampler import Upscaler, halton_jitter
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler.methods.registry import methods
from supersampler_bench.specs import with_default_gbuffers
from supersampler_model.data.scenes.analytic import DiscOverPlane

FOLDER = Path(__file__).parent / "golden"
RENDER, FRAME = (64, 36), 12


class Run(NamedTuple):
    """A method in a backend; with `extrapolation`, every second frame is unshaded, the last one too."""

    method: str
    executor: str
    extrapolation: str | None = None

    @property
    def path(self) -> Path:
        return FOLDER / self.executor / f"{'+'.join(filter(None, (self.method, self.extrapolation)))}.png"


RUNS = [
    *(Run(method, kind) for method, kind in BACKENDS if kind == "onnx" or methods()[method].history),
    Run("taau", "onnx", "guided-flow"),
    Run("taau", "cpu", "guided-warp"),
]


def rendered(run: Run) -> NDArray[np.uint8]:
    """Return frame 12 of a disc that crosses a panning checker, as display values."""
    model = shared_model(run.method, run.executor)
    ratio = model.info.only_ratio or 2.0
    display = round(RENDER[0] * ratio), round(RENDER[1] * ratio)
    upscaler = Upscaler(model, display_size=display, extrapolation=run.extrapolation, validate="off")
    for index in range(FRAME + 1):
        frame = DiscOverPlane().frame(index, RENDER, halton_jitter(index, ratio))
        frame = with_default_gbuffers(frame, upscaler.gbuffers, display)
        if run.extrapolation is not None and index % 2 == FRAME % 2 and index > 0:
            image = upscaler.extrapolate(replace(frame, color=None))
        else:
            image = upscaler.step(frame)
    return to_uint8(display_transform(image))


def stored(run: Run) -> NDArray[np.uint8]:
    return np.asarray(ImageBuf(str(run.path)).get_pixels("uint8"))


@pytest.mark.parametrize("run", RUNS, ids=lambda run: f"{run.executor}-{run.path.stem}")
def test_a_method_renders_its_golden_image(run: Run, tmp_path: Path) -> None:
    image = rendered(run)
    write_png(tmp_path / run.path.name, image)
    off = np.abs(image.astype(int) - stored(run))
    hint = f"rendered: {tmp_path / run.path.name}; if it is better, run python tests/test_golden.py"
    assert (off > 2).mean() < 0.001, hint
    assert off.mean() < 0.05, hint


if __name__ == "__main__":
    for each in RUNS:
        write_png(each.path, rendered(each))
