"""Draws families.jpg of docs/data.md: a frame of each family of scenes, and the classes of its pixels.

python docs/images/families.py
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from supersampler.io.display import display_transform, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg
from supersampler_model.data.dataset.overview import overlay
from supersampler_model.data.labels import label
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import (
    APART_FAMILIES,
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    SequenceSpec,
    make_sequence,
)

SIZE = (240, 135)
ACROSS = 3  # families in a row
SEED, FRAME = 6, 12


def main() -> None:
    """Render all families."""
    renderer = Renderer(SIZE)
    families = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
    tiles = [reference_and_classes(renderer, family) for family in families]
    tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % ACROSS)
    rows = [np.concatenate(tiles[i : i + ACROSS], axis=1) for i in range(0, len(tiles), ACROSS)]
    with replacing(Path(__file__).with_suffix(".jpg")) as partial:
        partial.write_bytes(encode_jpeg(np.concatenate(rows), quality=85))


def reference_and_classes(renderer: Renderer, family: str) -> NDArray[np.uint8]:
    """Return the reference of one frame, and its classes over it, side by side."""
    sequence = make_sequence(SequenceSpec(family=family, seed=SEED, frames=24))
    before, now = (
        renderer.render(sequence.scene(index), SIZE, jitter=(0.0, 0.0), reset=sequence.cut(index))
        for index in (FRAME - 1, FRAME)
    )
    image = to_uint8(display_transform(now.reference.color, now.exposure))
    labels = label(now.evidence(now.exposure), before.evidence(now.exposure))
    return np.concatenate([image, overlay(labels, image)], axis=1)


if __name__ == "__main__":
    main()
