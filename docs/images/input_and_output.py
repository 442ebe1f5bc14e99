"""Makes input-and-output.jpg of the README: crops of the shipped shot: rendered, upscaled, reference.

python docs/images/input_and_output.py
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import supersampler
from supersampler import Shot, Upscaler
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg

FRAME, RATIO, ZOOM = 27, 2, 2
CROP = (240, 135)  # width and height in display pixels
CORNERS = ((60, 30), (330, 190))  # left, top
GAP = 8


def main() -> None:
    """Upscale the shot up to `FRAME` and write its crops: a row for each corner."""
    upscaler = Upscaler("classifier", scale=RATIO)
    for item in Shot.open(Path(supersampler.__file__).parent / "shots/plaza"):
        image = upscaler.step(item.frame)
        if item.index == FRAME:
            break
    if item.frame.color is None or item.reference is None:
        raise SystemExit(f"frame {FRAME} has no colour or no reference")
    rendered = item.frame.color.repeat(RATIO, axis=0).repeat(RATIO, axis=1)  # nearest: every pixel shows
    exposure = auto_exposure(item.reference)
    shown = [to_uint8(display_transform(part, exposure)) for part in (rendered, image, item.reference)]
    rows = [np.concatenate([crop(part, corner) for part in shown], axis=1) for corner in CORNERS]
    with replacing(Path(__file__).with_suffix(".jpg").with_stem("input-and-output")) as partial:
        partial.write_bytes(encode_jpeg(np.concatenate(rows), quality=88))


def crop(image: NDArray[np.uint8], corner: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a crop, enlarged by nearest pixels, with a white border at its right and bottom."""
    (left, top), (width, height) = corner, CROP
    part = image[top : top + height, left : left + width].repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
    return np.pad(part, ((0, GAP), (0, GAP), (0, 0)), constant_values=255)


if __name__ == "__main__":
    main()
