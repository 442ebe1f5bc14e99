"""Make an image of the docs.

python docs/images/make.py NAME

input-and-output: crops of the shipped shot as rendered, upscaled, and its reference (README).
both-ways: crops of the shipped shot in one pass, in two passes, and its reference
    (docs/how-to/upscale-both-ways.md).
by-eye: crops of test shots by taau and classifier, and their references (docs/quality.md).
artifacts: crops of test shots with visible artifacts by bilinear, taau and classifier, and their references
    (docs/explanation/artifacts.md).
families: a frame of each family of scenes, and the classes of its pixels (docs/data.md).

by-eye and artifacts need the test shots: run `supersampler bench shots` first.
"""

import os
import sys
from collections.abc import Iterable
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler import Shot, Upscaler, upscale_sequence
from supersampler.io.display import auto_exposure, display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg
from supersampler_bench.shots.public_shots import CACHE_VARIABLE, default_cache, shot_folder
from supersampler_model.data import sequences
from supersampler_model.data.dataset.overview import overlay
from supersampler_model.data.rendered import labels_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.shots import render_frame, variant_name

Pixels = NDArray[np.uint8]
GAP = 8


def input_and_output() -> Pixels:
    """Return the image input-and-output."""
    upscaler = Upscaler("classifier", scale=2)
    for item in Shot.open("plaza"):
        image = upscaler.step(item.frame)
    if item.frame.color is None or item.reference is None:
        raise SystemExit(f"frame {item.index} has no colour or no reference")
    rendered = item.frame.color.repeat(2, axis=0).repeat(2, axis=1)
    parts = shown([rendered, image, item.reference], auto_exposure(item.reference))
    return np.concatenate([crops(parts, corner, (240, 135), zoom=2) for corner in ((60, 30), (330, 190))])


def both_ways() -> Pixels:
    """Return the image both-ways."""
    shot, index, (width, height) = Shot.open("plaza"), 13, (120, 68)
    size, reference = shot.display_size, shot.read_reference(index)
    if size is None or reference is None:
        raise SystemExit(f"frame {index} has no reference")
    images = [list(upscale_sequence(shot, display_size=size, passes=passes))[index] for passes in (1, 2)]
    exposure = auto_exposure(reference)
    one, two, ideal = (display_transform(image, exposure) for image in (*images, reference))
    gain = (np.abs(one - ideal) - np.abs(two - ideal)).sum(axis=2)
    tiles = gain[: gain.shape[0] // height * height, : gain.shape[1] // width * width]
    sums = tiles.reshape(-1, height, tiles.shape[1] // width, width).sum(axis=(1, 3))
    best = np.argsort(-sums, axis=None)[:2]  # the tiles that gain most by the second pass
    corners = [(int(i % sums.shape[1]) * width, int(i // sums.shape[1]) * height) for i in best]
    parts = shown([*images, reference], exposure)
    return np.concatenate([crops(parts, corner, (width, height), zoom=4) for corner in corners])


BY_EYE = (("rigging", 20, (60, 10)), ("court", 10, (160, 100)))
ARTIFACTS = (
    ("thin_movers", 16, (30, 196)),  # the first image after a cut
    ("moving_shadows", 12, (408, 285)),  # the edge of a moving shadow
    ("thin_movers", 14, (468, 183)),  # the trail of thin geometry
    ("thin_movers", 22, (371, 237)),  # static thin geometry, from a moving camera
)
"""Test shot, frame and corner of each crop."""


def of_test_shots(
    places: Iterable[tuple[str, int, tuple[int, int]]],
    methods: Iterable[str],
    size: tuple[int, int],
    zoom: int,
) -> Pixels:
    """Return a row of crops for each place: the image of each method, then the reference.

    A place is a test shot, a frame, and the corner of the crop; it and the crop's `size` are display pixels.
    """
    cache, rows = Path(os.environ.get(CACHE_VARIABLE) or default_cache()), []
    for name, index, corner in places:
        shot = Shot.open(shot_folder(cache, name) / f"{variant_name(2.0)}.json")
        upscalers = [Upscaler(method, display_size=shot.display_size) for method in methods]
        for item in islice(shot.frames(), index + 1):
            images = [upscaler.step(item.frame) for upscaler in upscalers]
        if item.reference is None:
            raise SystemExit(f"frame {index} of {name} has no reference")
        exposure = item.frame.exposure or auto_exposure(item.reference)
        rows.append(crops(shown([*images, item.reference], exposure), corner, size, zoom))
    return np.concatenate(rows)


def families() -> Pixels:
    """Return the image families."""
    size, index, columns = (240, 135), 12, 3
    renderer, tiles = Renderer(size), []
    for family in (*sequences.TRAIN_FAMILIES, *sequences.TEST_FAMILIES, *sequences.APART_FAMILIES):
        sequence = sequences.make_sequence(sequences.SequenceSpec(family=family, seed=6, frames=24))
        before, now = (render_frame(sequence, renderer, i, 1.0) for i in (index - 1, index))
        image = to_uint8(display_transform(now.reference.color, now.exposure))
        labels = labels_of(now, before)
        tiles.append(np.concatenate([image, overlay(labels, image)], axis=1))
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[i : i + columns], axis=1) for i in range(0, len(tiles), columns)]
    return np.concatenate(rows)


def shown(images: Iterable[NDArray[np.float32]], exposure: float) -> list[Pixels]:
    """Return the images after the display transform."""
    return [to_uint8(display_transform(np.asarray(image), exposure)) for image in images]


def crops(images: Iterable[Pixels], corner: tuple[int, int], size: tuple[int, int], zoom: int) -> Pixels:
    """Return a row of crops, enlarged by nearest pixels, with white borders at the right and the bottom."""
    (left, top), (width, height) = corner, size
    parts = [image[top : top + height, left : left + width] for image in images]
    parts = [part.repeat(zoom, axis=0).repeat(zoom, axis=1) for part in parts]
    border = ((0, GAP), (0, GAP), (0, 0))
    return np.concatenate([np.pad(part, border, constant_values=255) for part in parts], axis=1)


IMAGES = {
    "input-and-output": (input_and_output, 88),
    "both-ways": (both_ways, 88),
    "by-eye": (partial(of_test_shots, BY_EYE, ("taau", "classifier"), (240, 135), 2), 88),
    "artifacts": (partial(of_test_shots, ARTIFACTS, ("bilinear", "taau", "classifier"), (120, 68), 3), 88),
    "families": (families, 85),
}
"""Function and JPEG quality of each image."""

if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in IMAGES:
        sys.exit(__doc__)
    make, quality = IMAGES[sys.argv[1]]
    with replacing(Path(__file__).with_name(f"{sys.argv[1]}.jpg")) as partial:
        partial.write_bytes(encode_jpeg(make(), quality=quality))
