"""Pictures that must not change unawares. `python tests/golden.py` draws them anew: look, then commit."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from supersampler import Upscaler, display_transform, halton_jitter
from supersampler.display import to_uint8
from supersampler.image_io import write_png
from supersampler_model.data.analytic import DiscOverPlane

FOLDER = Path(__file__).parent / "golden"
METHODS = ["bilinear", "bicubic", "taa", "taau", "classifier", "classifier-small"]
RENDER, DISPLAY, FRAME = (64, 36), (128, 72), 12


def drawn(method: str) -> NDArray[np.uint8]:
    """Return frame 12 of a disc that crosses a panning checker, as a screen shows it."""
    upscaler = Upscaler(method, display_size=DISPLAY, executor="graph", validate="off")
    for index in range(FRAME + 1):
        image = upscaler.step(DiscOverPlane().frame(index, RENDER, halton_jitter(index, 2.0)))
    return to_uint8(display_transform(image))


def stored(method: str) -> NDArray[np.uint8]:
    """Return the picture of the repository."""
    return np.asarray(ImageBuf(str(FOLDER / f"{method}.png")).get_pixels("uint8"))


if __name__ == "__main__":
    for name in METHODS:
        write_png(FOLDER / f"{name}.png", drawn(name))
