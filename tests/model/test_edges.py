"""Upsampling of one frame along its edges, and the history of AOVs: sharp, and nothing that no sample has."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from supersampler_model import ops
from supersampler_model.methods.aovs import read_bounded

RENDER = ops.Size(24, 18)
DISPLAY = ops.Size(48, 36)
JITTER = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))


def upsampled(luma: Tensor, jitter: tuple[float, float], usable: Tensor | None = None) -> Tensor:
    grid = ops.grid_of(DISPLAY, RENDER, torch.tensor([jitter], dtype=torch.float32))
    return ops.upsample_along_edges(luma, torch.ones_like(luma) if usable is None else usable, grid)


def edge(size: ops.Size, angle: float, jitter: tuple[float, float] = (0.0, 0.0), samples: int = 1) -> Tensor:
    """Return an edge through the middle, (1, 1, h, w): 1 on one side of it, 0.2 on the other."""
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    x = (np.arange(size.width)[:, None] + 0.5 + steps + jitter[0]).ravel() / size.width - 0.5
    y = (np.arange(size.height)[:, None] + 0.5 + steps + jitter[1]).ravel() / size.height - 0.5
    x, y = x * RENDER.width, y * RENDER.height
    side = np.cos(angle) * x[None] + np.sin(angle) * y[:, None] > 0.0
    mean = side.reshape(size.height, samples, size.width, samples).mean(axis=(1, 3))
    return torch.from_numpy((0.2 + 0.8 * mean).astype(np.float32))[None, None]


def error(image: Tensor, truth: Tensor) -> float:
    return float((image - truth)[..., 6:-6, 6:-6].square().mean().sqrt())


@pytest.mark.parametrize("degrees", [10, 20, 30, 40, 50, 65, 80])
def test_an_edge_at_a_slant_has_less_error_than_by_bilinear(degrees: int) -> None:
    ours = theirs = 0.0
    truth = edge(DISPLAY, np.radians(degrees), samples=8)
    for jitter in ((0.0, 0.0), (0.3, -0.2), (-0.4, 0.1), (0.15, 0.45)):
        frame = edge(RENDER, np.radians(degrees), jitter)
        grid = ops.grid_of(DISPLAY, RENDER, torch.tensor([jitter], dtype=torch.float32))
        bilinear = ops.resample(frame, *grid.bands(RENDER, ops.linear, reach=1))
        ours += error(upsampled(frame, jitter), truth)
        theirs += error(bilinear, truth)
    assert ours < 0.95 * theirs


@settings(max_examples=30)
@given(seed=st.integers(0, 99), jitter=JITTER, missing=st.floats(0.0, 1.0))
def test_the_result_is_a_mean_of_usable_samples(
    seed: int, jitter: tuple[float, float], missing: float
) -> None:
    random = np.random.default_rng(seed)
    usable = torch.from_numpy((random.random((1, 1, 18, 24)) >= missing).astype(np.float32))
    luma = torch.from_numpy(random.random((1, 1, 18, 24)).astype(np.float32))
    luma = torch.where(usable > 0.0, luma, 0.5)  # as missing samples are filled
    result = upsampled(luma, jitter, usable)
    assert float(result.min()) >= float(luma.min()) - 1e-6
    assert float(result.max()) <= float(luma.max()) + 1e-6


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5])
def test_no_step_where_one_sample_takes_the_place_of_another(fraction: float) -> None:
    luma = torch.from_numpy(np.random.default_rng(3).random((1, 1, 18, 24)).astype(np.float32))
    edge_of_sample = 0.25 - fraction  # with it, positions of every second pixel are on a sample
    before, after = (upsampled(luma, (edge_of_sample + d, 0.1)) for d in (-1e-5, 1e-5))
    assert float((before - after).abs().max()) < 1e-3


@settings(max_examples=30)
@given(seed=st.integers(0, 99))
def test_the_history_of_aovs_stays_between_its_pixels(seed: int) -> None:
    random = np.random.default_rng(seed)
    image = torch.from_numpy((random.random((1, 2, 12, 16)) > 0.7).astype(np.float32))
    position = torch.from_numpy(random.uniform(-3.0, 19.0, (1, 9, 11, 2)).astype(np.float32))
    read, _ = read_bounded(image, position)
    assert float(read.min()) >= 0.0
    assert float(read.max()) <= 1.0
    whole = np.stack(np.meshgrid(np.arange(16.0), np.arange(12.0)), axis=-1)[None]
    same, _ = read_bounded(image, torch.from_numpy(whole.astype(np.float32)))
    torch.testing.assert_close(same, image, atol=1e-5, rtol=0.0)


def test_a_line_that_drifts_keeps_more_of_its_coverage_than_by_linear_reads() -> None:
    pixels, start, step, frames = torch.arange(48.0), 12.0, 1.0 / 3.0, 24
    ours = theirs = torch.exp(-0.5 * (pixels - start) ** 2 / 0.6**2).expand(1, 1, 3, 48)
    position = torch.stack(torch.meshgrid(pixels - step, torch.arange(3.0), indexing="xy"), dim=-1)[None]
    for _ in range(frames):
        (ours, _), theirs = read_bounded(ours, position), ops.read(theirs, position)
    place = round(start + frames * step)
    assert float(ours[0, 0, 1, place]) > 1.5 * float(theirs[0, 0, 1, place])
