"""Frames are denoised by Open Image Denoise itself: `make oidn`."""

from dataclasses import replace

import numpy as np
import pytest

from noisy_frames import decibels, noisy
from supersampler import denoise_sequence
from supersampler.denoising.oidn import Oidn
from supersampler.denoising.sequence import guides_of

pytest.importorskip("pyoidn", reason='needs Open Image Denoise: pip install "supersampler[denoise]"')


def test_color_and_guides_lose_their_noise() -> None:
    frame = noisy(0, noise=0.3)
    generator = np.random.default_rng(0)
    albedo = np.full((30, 48, 3), 0.5, np.float32)
    noisy_albedo = (albedo + 0.1 * generator.standard_normal(albedo.shape)).astype(np.float32)
    normal = np.asarray((frame.gbuffer or {})["normal"], np.float32)
    color = np.asarray(frame.color, np.float32)
    with Oidn(threads=1) as oidn:
        guide, other = oidn.clean_guides(noisy_albedo, normal)
        image, alone = oidn.denoise(color, guide, other), oidn.denoise(color, None, None)
        nothing = oidn.clean_guides(None, None)
    assert guide is not None
    assert other is not None
    assert nothing == (None, None)
    assert np.abs(guide - albedo).mean() < 0.5 * np.abs(noisy_albedo - albedo).mean()
    np.testing.assert_allclose(other, normal, atol=0.05)
    assert min(decibels(image, 0), decibels(alone, 0)) > decibels(color, 0) + 2.0
    np.testing.assert_array_equal(color, frame.color)


def test_neighbours_add_to_what_the_denoiser_gives() -> None:
    frames = [noisy(index, noise=0.3) for index in range(9)]
    images = list(denoise_sequence(frames, threads=1))
    with Oidn(threads=1) as oidn:
        guides = oidn.clean_guides(*guides_of(frames[4]))
        alone = oidn.denoise(np.asarray(frames[4].color, np.float32), *guides)
    assert decibels(images[4], 4) > decibels(alone, 4) + 1.5


def test_missing_samples_are_filled() -> None:
    frames = [noisy(index, noise=0.1) for index in range(3)]
    color = np.array(frames[1].color)
    color[10:12, 10:12] = np.nan
    frames[1] = replace(frames[1], color=color)
    assert np.isfinite(np.stack(list(denoise_sequence(frames, threads=1)))).all()
