"""Noise of path tracers, as training crops have it."""

import numpy as np
import pytest
import torch

from supersampler.frame import Float32
from supersampler_model import ops
from supersampler_model.training.crops import NOISE_CHANCE, SAMPLES, PathNoise

COLOR = torch.rand(1, 3, 64, 64, generator=torch.Generator().manual_seed(0))


def noise(samples: int, *, certain: float = 0.0, missed: float = 0.0, spread: float = 1.0) -> PathNoise:
    return PathNoise(samples, certain, missed, spread)


def ratios(of: PathNoise, seed: int = 0) -> Float32:
    noisy = of.on(COLOR, np.random.default_rng(seed))
    found: Float32 = (noisy / COLOR)[0].numpy()
    return found


@pytest.mark.parametrize("of", [noise(16), noise(16, certain=0.8), noise(16, missed=0.3, spread=0.6)])
def test_noise_keeps_the_mean(of: PathNoise) -> None:
    means = [ratios(of, seed).mean() for seed in range(8)]
    assert np.mean(means) == pytest.approx(1.0, abs=0.02)


def test_four_times_the_samples_halve_the_noise() -> None:
    few, many = (np.std([ratios(noise(n, spread=0.6), s) for s in range(4)]) for n in (4, 16))
    assert few / many == pytest.approx(2.0, rel=0.1)


def test_paths_that_bring_nothing_leave_pixels_black() -> None:
    black = (ratios(noise(1, missed=0.3)) == 0.0).mean()
    assert black == pytest.approx(0.3, abs=0.03)


def test_bright_surfaces_have_less_noise_than_dark_ones_where_light_is_certain() -> None:
    scene = torch.cat([torch.full((1, 3, 32, 64), 0.1), torch.full((1, 3, 32, 64), 4.0)], dim=2)
    found = (noise(4, certain=0.8).on(scene, np.random.default_rng(1)) / scene)[0, 0]
    assert found[32:].std() < 0.6 * found[:32].std()


def test_all_channels_of_a_pixel_have_one_factor() -> None:
    found = ratios(noise(1))
    np.testing.assert_allclose(found[0], found[2], rtol=1e-5)


def test_the_brightest_light_stays_a_half_float() -> None:
    bright = noise(1, spread=1.3).on(torch.full((1, 3, 64, 64), 60000.0), np.random.default_rng(2))
    assert bright.max() == ops.MAX_HALF


def test_a_few_crops_have_noise_and_the_same_seed_draws_the_same() -> None:
    drawn = [PathNoise.draw(np.random.default_rng(seed)) for seed in range(2000)]
    noisy = [one for one in drawn if one is not None]
    assert len(noisy) / len(drawn) == pytest.approx(NOISE_CHANCE, rel=0.3)
    assert {one.samples for one in noisy} == set(SAMPLES)
    assert drawn[:50] == [PathNoise.draw(np.random.default_rng(seed)) for seed in range(50)]
