"""Makes both-ways.jpg: crops of the shipped shot in one pass, in two passes, and its reference.

python docs/images/both_ways.py
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler import Shot, upscale_sequence
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg

FRAME, ZOOM, GAP = 18, 4, 8
CROP = (120, 68)  # width and height in display pixels
COUNT = 2  # crops, those in which the passes differ most


def main() -> None:
    """Upscale the shot once and twice, and write the crops: a row for each place."""
    shot = Shot.open("plaza")
    size, reference = shot.display_size, shot.read_reference(FRAME)
    if size is None or reference is None:
        raise SystemExit(f"frame {FRAME} has no reference")
    exposure = auto_exposure(reference)
    images = [list(upscale_sequence(shot, display_size=size, passes=passes))[FRAME] for passes in (1, 2)]
    shown = [display_transform(image, exposure) for image in (*images, reference)]
    gain = (np.abs(shown[0] - shown[2]) - np.abs(shown[1] - shown[2])).sum(axis=2)
    pixels = [to_uint8(image) for image in shown]
    rows = [np.concatenate([crop(image, corner) for image in pixels], axis=1) for corner in places(gain)]
    with replacing(Path(__file__).with_suffix(".jpg").with_stem("both-ways")) as partial:
        partial.write_bytes(encode_jpeg(np.concatenate(rows), quality=88))


def places(gain: NDArray[np.float32]) -> list[tuple[int, int]]:
    """Return the corners (left, top) of the crops with the largest sums, which do not overlap."""
    width, height = CROP
    tiles = gain[: gain.shape[0] // height * height, : gain.shape[1] // width * width]
    sums = tiles.reshape(-1, height, tiles.shape[1] // width, width).sum(axis=(1, 3))
    best = np.argsort(-sums, axis=None)[:COUNT]
    return [(int(i % sums.shape[1]) * width, int(i // sums.shape[1]) * height) for i in best]


def crop(image: NDArray[np.uint8], corner: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a crop, enlarged by nearest pixels, with a white border at its right and bottom."""
    (left, top), (width, height) = corner, CROP
    part = image[top : top + height, left : left + width].repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
    return np.pad(part, ((0, GAP), (0, GAP), (0, 0)), constant_values=255)


if __name__ == "__main__":
    main()
