"""Make denoise.webp: a film of a part of a scene with noise, denoised frame by frame, and over time.

pip install ".[bench,denoise]"
python docs/images/denoise_film.py RENDERS      # a folder of denoise_scenes.py, with room-4
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from supersampler import denoise_sequence
from supersampler.denoising.oidn import Oidn
from supersampler.denoising.sequence import guides_of
from supersampler.frame import Float32
from supersampler.io.display import to_uint8
from supersampler.io.shot import Shot, import_blender
from supersampler_bench.quality.denoise import displayed

RENDER = "room-4"
PART = slice(60, 280), slice(180, 400)  # rows and columns: the fan, the table, the ball
GAP = 6
MILLISECONDS = 83  # per frame: 12 frames per second, so that flicker is easier to see
QUALITY = 72


def main(renders: Path) -> None:
    """Write the film."""
    shot = import_blender(renders / RENDER, guides="denoising")
    ways = zip(noisy(shot), alone(shot), denoise_sequence(shot), strict=True)
    first, *others = [Image.fromarray(side_by_side(images)) for images in ways]
    path = Path(__file__).with_name("denoise.webp")
    first.save(path, save_all=True, append_images=others, duration=MILLISECONDS, loop=0, quality=QUALITY)


def noisy(shot: Shot) -> list[Float32]:
    """Return the frames as they were rendered."""
    return [np.asarray(item.frame.color, np.float32) for item in shot.frames()]


def alone(shot: Shot) -> list[Float32]:
    """Return the frames, each denoised by itself."""
    with Oidn() as oidn:
        return [
            oidn.denoise(np.asarray(item.frame.color, np.float32), *oidn.clean_guides(*guides_of(item.frame)))
            for item in shot.frames()
        ]


def side_by_side(images: tuple[Float32, ...]) -> np.ndarray:
    """Return the parts of three images in a row."""
    parts = [np.pad(to_uint8(displayed(image[PART])), ((0, 0), (0, GAP), (0, 0))) for image in images]
    return np.concatenate(parts, axis=1)[:, :-GAP]


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
