"""The temporal filter on recorded frames of Cycles, each denoised by Open Image Denoise, with references."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from supersampler import Shot, denoise_sequence
from supersampler.conventions.encodings import srgb_encoded
from supersampler.frame import Array, Float32
from supersampler.io.display import decibels

FOLDER = Path(__file__).parents[1] / "blender" / "denoised"  # by record_denoised.py beside it
EDGE = 8


@pytest.fixture(scope="module")
def recorded() -> Shot:
    return Shot.open(FOLDER)


def shown(image: Array | None) -> Float32:
    assert image is not None
    inside = np.asarray(image, np.float32)[EDGE:-EDGE, EDGE:-EDGE]
    return srgb_encoded(np.clip(inside, 0.0, 1.0))


def psnr(image: Float32, truth: Float32) -> float:
    return decibels(float(np.square(image - truth, dtype=np.float64).mean()))


@pytest.fixture(scope="module", params=[1, 2])
def films(request: pytest.FixtureRequest, recorded: Shot) -> tuple[list[Float32], ...]:
    """Return the frames with references as they were recorded, filtered, and their references."""
    images = list(denoise_sequence(recorded, per_frame="none", passes=request.param, samples=4, threads=1))
    indices = recorded.reference_indices
    frames = [shown(recorded.read(index).frame.color) for index in indices]
    truth = [shown(recorded.read_reference(index)) for index in indices]
    return frames, [shown(images[index]) for index in indices], truth


def test_neighbours_bring_every_frame_nearer_to_its_reference(films: tuple[list[Float32], ...]) -> None:
    gains = [psnr(image, truth) - psnr(frame, truth) for frame, image, truth in zip(*films, strict=True)]
    assert len(gains) == 3
    assert min(gains) > 0.2


def test_recorded_frames_flicker_less(films: tuple[list[Float32], ...]) -> None:
    frames, images, truth = ([after - before for before, after in pairwise(film)] for film in films)
    gains = [
        psnr(image, own) - psnr(frame, own) for frame, image, own in zip(frames, images, truth, strict=True)
    ]
    assert min(gains) > 0.35
