"""Makes by-eye.jpg of docs/quality.md: crops of test shots: taau, classifier, reference.

supersampler bench shots
python docs/images/by_eye.py
"""

import os
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Shot, Upscaler
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg
from supersampler_bench.shots.public_shots import CACHE_VARIABLE, default_cache, shot_folder
from supersampler_model.data.shots import variant_name

METHODS, ZOOM, GAP = ("taau", "classifier"), 2, 8


class Crop(NamedTuple):
    """A part of a frame; corner and size in display pixels."""

    shot: str
    frame: int
    left: int
    top: int
    width: int = 240
    height: int = 135


CROPS = (Crop("rigging", 20, 60, 10), Crop("court", 10, 160, 100))


def main() -> None:
    """Write the image: a row for each crop."""
    rows = [row(crop) for crop in CROPS]
    with replacing(Path(__file__).with_name("by-eye.jpg")) as partial:
        partial.write_bytes(encode_jpeg(np.concatenate(rows), quality=88))


def row(crop: Crop) -> NDArray[np.uint8]:
    """Upscale the shot up to the frame; return the crop of each method's image, and of the reference."""
    cache = Path(os.environ.get(CACHE_VARIABLE) or default_cache())
    shot = Shot.open(shot_folder(cache, crop.shot) / f"{variant_name(2.0)}.json")
    upscalers = [Upscaler(name, display_size=shot.display_size) for name in METHODS]
    for item in islice(shot.frames(), crop.frame + 1):
        images = [upscaler.step(item.frame) for upscaler in upscalers]
    if item.reference is None:
        raise SystemExit(f"frame {crop.frame} of {crop.shot} has no reference")
    exposure = item.frame.exposure or auto_exposure(item.reference)
    down, across = slice(crop.top, crop.top + crop.height), slice(crop.left, crop.left + crop.width)
    parts = [
        to_uint8(display_transform(image, exposure))[down, across] for image in (*images, item.reference)
    ]
    enlarged = [part.repeat(ZOOM, axis=0).repeat(ZOOM, axis=1) for part in parts]
    return np.concatenate(
        [np.pad(p, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for p in enlarged], axis=1
    )


if __name__ == "__main__":
    main()
