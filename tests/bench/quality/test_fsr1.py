"""`easu` and `easu-rcas`: FSR 1's formulas on small images whose results are known."""

from dataclasses import replace

import numpy as np
import pytest

from supersampler import Frame, FrameError, halton_jitter
from supersampler.frame import Array
from supersampler.io.display import display_transform
from supersampler_bench.fsr1 import Fsr1, easu_weights, filtered, rcas
from supersampler_bench.quality.metrics import crop, psnr
from supersampler_model.data.scenes.analytic import DiscOverPlane, Plane, plain

RENDER, DISPLAY = (48, 27), (96, 54)
ORIGIN = (0.0, 0.0)


def upsampled(plane: Array, jitter: tuple[float, float] = ORIGIN) -> Array:
    """Return a plane of luma, (27, 48), upsampled to DISPLAY."""
    weights, columns, rows = easu_weights(plane, jitter, DISPLAY)
    return filtered(plane[..., None], weights, columns, rows)[..., 0]


def test_weights_sum_to_one_and_a_uniform_image_is_unchanged() -> None:
    noise = np.random.default_rng(0).random((27, 48), np.float32)
    weights, *_ = easu_weights(noise, (0.2, -0.3), DISPLAY)
    np.testing.assert_allclose(np.sum(weights, axis=0), 1.0, atol=1e-5)
    np.testing.assert_allclose(upsampled(np.full((27, 48), 0.4, np.float32)), 0.4, atol=1e-5)


def test_at_ratio_one_without_edges_samples_are_unchanged() -> None:
    plane = np.zeros((27, 48), np.float32)
    weights, columns, rows = easu_weights(plane, ORIGIN, RENDER)
    noise = np.random.default_rng(0).random((27, 48, 3), np.float32)
    np.testing.assert_allclose(filtered(noise, weights, columns, rows), noise, atol=1e-5)


def test_samples_lie_at_pixel_centre_plus_jitter() -> None:
    x = np.arange(48, dtype=np.float32) + 0.5
    for jitter in (-0.4, 0.0, 0.3):
        ramp = np.broadcast_to((x + jitter) / 48.0, (27, 48)).astype(np.float32)
        expected = (np.arange(96) + 0.5) / 96.0
        np.testing.assert_allclose(upsampled(ramp, (jitter, 0.0))[20, 8:-8], expected[8:-8], atol=0.004)


def test_an_edge_is_smoother_along_itself_than_by_bilinear_interpolation() -> None:
    y, x = np.mgrid[:27, :48]
    edge = np.clip((x - 24.0) - 0.45 * (y - 13.0) + 0.5, 0.0, 1.0).astype(np.float32)
    row, column = np.mgrid[:54, :96] * 0.5 - 0.25
    truth = np.clip((column - 24.0) - 0.45 * (row - 13.0) + 0.5, 0.0, 1.0)
    top, left = np.clip(np.floor(row).astype(int), 0, 25), np.clip(np.floor(column).astype(int), 0, 46)
    down, right = row - top, column - left
    bilinear = (edge[top, left] * (1 - right) + edge[top, left + 1] * right) * (1 - down)
    bilinear += (edge[top + 1, left] * (1 - right) + edge[top + 1, left + 1] * right) * down
    inner = np.s_[8:-8, 8:-8]
    errors = [np.square(image - truth)[inner].mean() for image in (upsampled(edge), bilinear)]
    assert errors[0] < 0.7 * errors[1]


def test_nothing_rings_beyond_the_four_nearest_samples() -> None:
    frame = DiscOverPlane().frame(0, RENDER)
    assert frame.color is not None
    image, _ = Fsr1(DISPLAY, sharpens=False).step(replace(frame, exposure=1.0))
    shown, samples = display_transform(image), display_transform(frame.color)
    assert shown.min() > samples.min() - 1e-3
    assert shown.max() < samples.max() + 1e-3


def test_sharpening_keeps_flat_areas_raises_contrast_and_stays_in_range() -> None:
    flat = np.full((9, 9, 3), 0.3, np.float32)
    np.testing.assert_allclose(rcas(flat), flat, atol=1e-6)
    dot = flat.copy()
    dot[4, 4] = 0.5
    assert rcas(dot)[4, 4, 0] > 0.52
    extremes = np.random.default_rng(1).integers(0, 2, (20, 20, 3)).astype(np.float32)
    assert rcas(extremes).min() >= -1e-5
    assert rcas(extremes).max() <= 1.0 + 1e-5


def test_images_are_linear_near_the_truth_and_sharper_with_rcas() -> None:
    scene = DiscOverPlane()
    frame, truth = scene.frame(3, RENDER, halton_jitter(3, 2.0)), scene.truth(3, DISPLAY)
    plain_image, _ = Fsr1(DISPLAY, sharpens=False).step(frame)
    sharp, _ = Fsr1(DISPLAY, sharpens=True).step(frame)
    assert psnr(*(crop(display_transform(image), 4) for image in (plain_image, truth))) > 18.0
    assert sharp.std() > plain_image.std()
    even, _ = Fsr1(DISPLAY, sharpens=True).step(Plane(plain).frame(0, RENDER))
    np.testing.assert_allclose(even, Plane(plain).truth(0, DISPLAY), rtol=1e-3)


def test_aovs_are_filtered_like_the_image() -> None:
    frame = DiscOverPlane().frame(0, RENDER)
    half = np.zeros((27, 48, 2), np.float32)
    half[:, 24:, 0], half[..., 1] = 1.0, 0.5
    _, aovs = Fsr1(DISPLAY, sharpens=True).step(replace(frame, aovs=half))
    assert aovs is not None
    assert aovs.shape == (54, 96, 2)
    np.testing.assert_allclose(aovs[..., 1], 0.5, atol=1e-5)
    assert (aovs[:, :44, 0] == 0.0).all()
    assert (aovs[:, 52:, 0] == 1.0).all()


def test_a_frame_that_was_not_shaded_is_refused() -> None:
    frame: Frame = replace(Plane(plain).frame(0, RENDER), color=None)
    with pytest.raises(FrameError, match="color"):
        Fsr1(DISPLAY, sharpens=False).step(frame)
