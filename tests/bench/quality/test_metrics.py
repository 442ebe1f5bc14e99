"""Each metric equals a value worked out by hand or a slow, direct implementation."""

import math
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from supersampler import ArgumentError, SupersamplerError
from supersampler.io.display import CEILING_DB
from supersampler_bench.quality import metrics

Image = NDArray[np.float64]


def grey(level: float, size: tuple[int, int] = (20, 24)) -> Image:
    return np.full((*size, 3), level)


def noise(seed: int, size: tuple[int, int] = (20, 24)) -> Image:
    return np.random.default_rng(seed).uniform(0, 1, (*size, 3))


def test_psnr_is_over_all_three_channels_and_finite_for_equal_images() -> None:
    image = grey(0.5)
    image[..., 1] += 0.1  # a third of the values, so a third of the error
    assert metrics.psnr(grey(0.6), grey(0.5)) == pytest.approx(20.0)
    assert metrics.psnr(image, grey(0.5)) == pytest.approx(20.0 + 10 * math.log10(3))
    assert metrics.psnr(noise(0), noise(0)) == CEILING_DB


def test_psnr_in_a_mask_ignores_pixels_outside_of_it() -> None:
    image, mask = grey(0.5), np.zeros((20, 24), bool)
    image[:10] = 0.0
    image[10:] += 0.01
    mask[10:] = True
    assert metrics.psnr(image, grey(0.5), mask) == pytest.approx(40.0)
    assert math.isnan(metrics.psnr(image, grey(0.5), np.zeros((20, 24), bool)))


def slow_ssim(x: Image, y: Image) -> float:
    """Wang et al. 2004, one window at a time."""
    window = np.array([[math.exp(-(i * i + j * j) / 4.5) for i in range(-5, 6)] for j in range(-5, 6)])
    window /= window.sum()
    values = []
    for row in range(x.shape[0] - 10):
        for column in range(x.shape[1] - 10):
            a, b = x[row : row + 11, column : column + 11], y[row : row + 11, column : column + 11]
            ma, mb = (window * a).sum(), (window * b).sum()
            va, vb = (window * (a - ma) ** 2).sum(), (window * (b - mb) ** 2).sum()
            cov = (window * (a - ma) * (b - mb)).sum()
            values.append(
                (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma**2 + mb**2 + 1e-4) * (va + vb + 9e-4))
            )
    return float(np.mean(values))


def test_ssim_is_its_definition_on_bt709_luma() -> None:
    image, reference = noise(1), noise(2)
    luma = np.array([0.2126, 0.7152, 0.0722])
    assert metrics.ssim(image, reference) == pytest.approx(slow_ssim(image @ luma, reference @ luma))
    assert metrics.ssim(image, image) == pytest.approx(1.0)


def test_ssim_refuses_images_smaller_than_its_window() -> None:
    with pytest.raises(ArgumentError, match=r"is \(10, 24, 3\); want at least 11 x 11 pixels"):
        metrics.ssim(grey(0, (10, 24)), grey(0, (10, 24)))


def test_flip_is_0_for_equal_images_at_most_1_and_local() -> None:
    pytest.importorskip("flip_evaluator")
    image = noise(3, (40, 60))
    assert metrics.flip_map(image, image).max() == 0.0
    opposite = metrics.flip_map(grey(1.0, (40, 60)), grey(0.0, (40, 60)))
    assert opposite.shape == (40, 60)
    assert 0.9 < opposite.mean() <= 1.0
    spot = image.copy()
    spot[5:8, 5:8] = 1.0 - spot[5:8, 5:8]
    errors = metrics.flip_map(spot, image)
    assert errors[6, 6] > 0.1 > 10 * errors[30:, 40:].max()


def test_flip_without_its_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(SupersamplerError, match=r"pip install 'supersampler\[bench\]'"):
        metrics.flip_map(grey(0), grey(0))


def test_tpsnr_forgives_a_fixed_error_and_sees_flicker() -> None:
    before, after = noise(4), noise(5)
    assert metrics.tpsnr(after + 0.1, before + 0.1, after, before) == pytest.approx(CEILING_DB)
    assert metrics.tpsnr(after + 0.05, before - 0.05, after, before) == pytest.approx(20.0)


@given(
    x=st.floats(-4, 4, width=32),
    y=st.floats(-4, 4, width=32),
    width=st.integers(1, 9),
    height=st.integers(1, 7),
)
def test_warp_samples_at_p_plus_motion_bilinearly(x: float, y: float, width: int, height: int) -> None:
    rows, columns = np.indices((height, width))
    ramp = (10.0 * rows + columns)[..., None]
    warped, inside = metrics.warp(ramp, np.broadcast_to((x, y), (height, width, 2)))
    from_x, from_y = columns + x, rows + y
    on_screen = (np.abs(from_x - (width - 1) / 2) <= width / 2) & (
        np.abs(from_y - (height - 1) / 2) <= height / 2
    )
    np.testing.assert_array_equal(inside, on_screen)
    between = (from_x >= 0) & (from_x <= width - 1) & (from_y >= 0) & (from_y <= height - 1)
    np.testing.assert_allclose(warped[between, 0], (10 * from_y + from_x)[between], atol=1e-9)


def test_nan_motion_has_no_history() -> None:
    assert not metrics.warp(noise(0), np.full((20, 24, 2), np.nan))[1].any()


def test_warped_error_is_zero_for_a_pan_and_the_change_otherwise() -> None:
    before = noise(6)
    after = np.roll(before, 3, axis=1)  # the image moved right, so it came from the left
    motion = np.zeros((20, 24, 2), np.float32)
    motion[..., 0] = -3
    valid = np.ones((20, 24), bool)
    assert metrics.warped_error(after, before, motion, valid) == pytest.approx(0.0)
    assert metrics.warped_error(after + 0.1, before, motion, valid) == pytest.approx(0.1)
    assert metrics.warped_error(after, before, -motion, valid) > 0.2
    assert math.isnan(metrics.warped_error(after, before, motion, ~valid))


def test_warped_error_difference_counts_an_image_that_changes_too_little() -> None:
    motion, valid = np.zeros((20, 24, 2)), np.ones((20, 24), bool)
    shimmer, frozen = (grey(0.6), grey(0.5)), (grey(0.5), grey(0.5))
    assert metrics.warped_error_difference(*frozen, *shimmer, motion, valid) == pytest.approx(0.1)
    assert metrics.warped_error_difference(*shimmer, *frozen, motion, valid) == pytest.approx(0.1)
    assert metrics.warped_error_difference(*shimmer, *shimmer, motion, valid) == 0.0


def test_crop_removes_the_border_on_every_side() -> None:
    image = noise(7)
    np.testing.assert_array_equal(metrics.crop(image, 8), image[8:12, 8:16])
    np.testing.assert_array_equal(metrics.crop(image, 0), image)
