"""Pictures that must not change unawares. `python tests/golden.py` draws them anew: look, then commit."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from supersampler import Model, Upscaler, display_transform, halton_jitter
from supersampler.io.display import to_uint8
from supersampler.io.images import write_png
from supersampler_bench.compatibility import with_default_gbuffers
from supersampler_model.data.scenes.analytic import DiscOverPlane

FOLDER = Path(__file__).parent / "golden"
METHODS = [
    *("bilinear", "bicubic", "taa", "taau", "classifier", "classifier-small"),
    *("gbuffer-small", "gbuffer-small-4x", "extrapolate"),
]
RENDER, FRAME = (64, 36), 12


def drawn(method: str) -> NDArray[np.uint8]:
    """Return frame 12 of a disc that crosses a panning checker, as a screen shows it."""
    model = Model.load(method, executor="onnx")
    ratio = model.info.only_ratio or 2.0
    display = round(RENDER[0] * ratio), round(RENDER[1] * ratio)
    upscaler = Upscaler(model, display_size=display, validate="off")
    for index in range(FRAME + 1):
        frame = DiscOverPlane().frame(index, RENDER, halton_jitter(index, ratio))
        image = upscaler.step(with_default_gbuffers(frame, model.info.gbuffers, display))
    return to_uint8(display_transform(image))


def stored(method: str) -> NDArray[np.uint8]:
    """Return the picture of the repository."""
    return np.asarray(ImageBuf(str(FOLDER / f"{method}.png")).get_pixels("uint8"))


if __name__ == "__main__":
    for name in METHODS:
        write_png(FOLDER / f"{name}.png", drawn(name))
