"""STRRED equals values of published code on fixed clips; which errors it detects and which it misses."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler_bench.quality import strred

Clip = NDArray[np.uint8]
SIZE = (101, 150)  # (height, width), odd at the first level and at others


def hashed(rows: NDArray[np.intp], columns: NDArray[np.intp], seed: int) -> NDArray[np.float64]:
    """Uniform in [0, 1), by integers alone: the same on every machine."""
    low = np.uint64(0xFFFFFFFF)
    x = rows.astype(np.uint64) * 73856093 ^ columns.astype(np.uint64) * 19349663 ^ np.uint64(83492791 * seed)
    for _ in range(2):
        x = ((x ^ (x >> np.uint64(16))) * np.uint64(0x45D9F3B)) & low
    return (x ^ (x >> np.uint64(16))).astype(np.float64) % 2**32 / 2**32


def texture(seed: int, shift: int = 0) -> NDArray[np.float64]:
    """(h, w) in [0, 1]: squares of 1 to 32 pixels whose contrast grows with their size."""
    rows, columns = np.indices(SIZE)
    octaves = (2**k * hashed(rows >> k, (columns + shift) >> k, seed + k) for k in range(6))
    return np.asarray(sum(octaves) / 63.0)


def scene(time: int) -> NDArray[np.float64]:
    """(h, w) in [0, 255]: a disc that moves by 5 pixels a frame, before a background that moves by 2."""
    rows, columns = np.indices(SIZE)
    disc = (rows - 50) ** 2 + (columns - 60 - 5 * time) ** 2 < 30**2
    return 255.0 * np.where(disc, np.roll(texture(11), 5 * time, axis=1), texture(1, shift=2 * time))


def blurred(image: NDArray[np.float64]) -> NDArray[np.float64]:
    """A mean of 3x3, six times over."""
    height, width = SIZE
    for _ in range(6):
        padded = np.pad(image, 1, mode="edge")
        shifted = (padded[i : i + height, j : j + width] for i in range(3) for j in range(3))
        image = np.mean(list(shifted), axis=0)
    return image


def clip(frame: Callable[[int], NDArray[np.float64]]) -> Clip:
    return np.stack([np.clip(np.rint(frame(time)), 0, 255) for time in range(4)]).astype(np.uint8)


REFERENCE = clip(scene)
CLIPS = {
    "blur": clip(lambda time: blurred(scene(time))),
    "stain": clip(lambda time: scene(time) + 51.0 * (texture(100) - 0.5)),
    "flicker": clip(lambda time: scene(time) + 51.0 * (texture(100 + 7 * time) - 0.5)),
    "late": clip(lambda time: 0.5 * scene(time) + 0.5 * scene(time - 1)),
}
PUBLISHED = {  # SRRED and TRRED of both pairs by scikit-video 1.1.11, skvideo.measure.strred, in float32
    "blur": [(1.9182, 2.5817), (2.3373, 2.6427)],
    "stain": [(13.7793, 7.6586), (9.6189, 5.3752)],
    "flicker": [(13.7793, 30.5997), (14.6525, 33.6814)],
    "late": [(6.1690, 10.2739), (6.3143, 10.3105)],
}


def pairs(distorted: Clip) -> list[tuple[float, float]]:
    """SRRED and TRRED of the pairs (0, 1) and (2, 3)."""
    bands = [[strred.band(frame.astype(float)) for frame in frames] for frames in (distorted, REFERENCE)]
    found = [[strred.information(*of[i : i + 2]) for i in (0, 2)] for of in bands]
    return [strred.distance(pair, reference) for pair, reference in zip(*found, strict=True)]


@pytest.mark.parametrize("name", CLIPS)
def test_the_values_are_those_of_published_code(name: str) -> None:
    np.testing.assert_allclose(pairs(CLIPS[name]), PUBLISHED[name], rtol=1e-3)  # it has no ridge


def test_flicker_of_the_whole_image_is_not_detected() -> None:
    darker = REFERENCE // 2 + 60
    brighter = darker + np.array([0, 9, 0, 9], np.uint8)[:, None, None]
    bands = [[strred.band(frame.astype(float)) for frame in frames[:2]] for frames in (darker, brighter)]
    assert max(strred.distance(*(strred.information(*of) for of in bands))) < 1e-6


def test_a_still_image_has_no_temporal_information() -> None:
    still = strred.band(REFERENCE[0].astype(float))
    assert not strred.information(still, still).temporal.any()
    assert not strred.information(still, still + 1e-9).temporal.any()  # rounding


def test_a_pattern_that_repeats_has_finite_information() -> None:
    rows = np.indices((96, 96))[0]
    before, after = (127.0 + 100.0 * np.sin((rows + 3 * i) * np.pi / 16) for i in range(2))
    found = strred.information(strred.band(before), strred.band(after))
    assert np.isfinite(found).all()
    assert np.abs(found).max() < 1e4


def test_the_band_passes_changes_from_row_to_row() -> None:
    waves = 100.0 * np.sin(np.indices((128, 128)) * np.pi / 16)
    horizontal, vertical = (np.abs(strred.band(wave)[2:-2, 2:-2]).mean() for wave in waves)
    assert horizontal > 50.0 * vertical
    assert strred.band(np.full((101, 64), 200.0)).shape == (13, 8)
    assert np.abs(strred.band(np.full((101, 64), 200.0))).max() < 1e-4


def test_images_too_small_for_a_block_have_no_distance() -> None:
    small = strred.band(np.zeros((16, 100)))
    pair = strred.information(small, small)
    assert np.isnan(strred.distance(pair, pair)).all()


def test_luma_is_of_8_bit_values() -> None:
    shown = np.array([[[1.0, 1.0, 1.0], [0.5, 0.5, 0.5], [0.0, 1.0, 0.0]]], np.float32)
    np.testing.assert_allclose(strred.luma255(shown), [[255.0, 128.0, 0.7152 * 255.0]])
