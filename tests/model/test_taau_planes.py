"""Planes of luma: moments of smooth surfaces and of edges in `taau`."""

import pytest
import torch
from torch import Tensor

from supersampler_model import ops
from supersampler_model.methods.taau import Moments, fit_of, plane_moments, shade_of

RENDER = ops.Size(12, 9)
SIGMA = 0.4
X, Y = torch.arange(12.0).expand(9, 12), torch.arange(9.0)[:, None].expand(9, 12)


def grey(luma: Tensor) -> Tensor:
    return torch.cat([luma[None, None], torch.zeros(1, 2, *luma.shape)], dim=1)


def fit(luma: Tensor, usable: Tensor | None = None) -> Tensor:
    usable = torch.ones(1, 1, 9, 12) if usable is None else usable
    image = luma[None, None] * usable
    return fit_of(image, usable, shade_of(image, usable)[:, 1:2])


def inner(image: Tensor, ratio: float) -> Tensor:
    """Pixels whose windows are inside the image."""
    border = int(3 * ratio)
    return image[..., border:-border, border:-border]


@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0])
@pytest.mark.parametrize(("across", "down"), [(0.02, 0.0), (0.0, -0.03), (-0.01, 0.025)])
def test_a_ramp_has_no_variance_and_its_own_value_at_each_pixel(
    ratio: float, across: float, down: float
) -> None:
    luma = 0.4 + across * X + down * Y
    grid = ops.grid_of(ops.Size(round(12 * ratio), round(9 * ratio)), RENDER, torch.tensor([[0.3, -0.2]]))
    whole = grid.pick(fit(luma))
    found = plane_moments(grey(luma), torch.ones(1, 1, 9, 12), whole, grid, SIGMA)
    expected = 0.4 + across * grid.x.position + down * grid.y.position[:, None]
    assert inner(whole, ratio).min() == 1.0
    torch.testing.assert_close(inner(found.center[0, 0], ratio), inner(expected, ratio), rtol=0.0, atol=1e-5)
    assert inner(found.variance[:, 0], ratio).max() < 1e-6


@pytest.mark.parametrize(
    "luma", [torch.where(X < 6.0, 0.2, 0.8), torch.where(X + Y < 9.0, 0.2, 0.8), 0.3 + 0.2 * ((X + Y) % 2.0)]
)
def test_edges_and_patterns_are_on_no_plane(luma: Tensor) -> None:
    assert fit(luma)[..., 1:-1, 1:-1].max() < 0.5


def test_where_no_plane_fits_moments_are_those_of_salvi() -> None:
    luma, usable = torch.rand(9, 12, generator=torch.Generator().manual_seed(1)), torch.ones(1, 1, 9, 12)
    grid = ops.grid_of(ops.Size(24, 18), RENDER, torch.tensor([[0.3, -0.2]]))
    found = plane_moments(grey(luma), usable, torch.zeros(1, 1, 18, 24), grid, SIGMA)
    first, second, _ = ops.local_moments(grey(luma), usable, grid, SIGMA)
    torch.testing.assert_close(found, Moments(first, second - first * first), rtol=0.0, atol=1e-5)


def test_where_a_sample_is_missing_there_is_no_plane_and_without_most_the_variance_is_1() -> None:
    usable = torch.ones(1, 1, 9, 12)
    usable[..., 4, 6] = 0.0
    usable[..., :, 9:] = 0.0
    luma = 0.4 + 0.02 * X
    assert (fit(luma, usable)[..., 3:6, 5:8] == 0.0).all()
    grid = ops.grid_of(ops.Size(24, 18), RENDER, torch.tensor([[0.3, -0.2]]))
    color, everywhere = grey(luma) * usable, torch.ones(1, 1, 18, 24)
    found = plane_moments(color, usable, everywhere, grid, SIGMA)
    without = plane_moments(color, usable, 0.0 * everywhere, grid, SIGMA)
    x, y = grid.x.position, grid.y.position
    beside = ((x - 6.0).abs() < 1.0) & ((y[:, None] - 4.0).abs() < 1.0)
    torch.testing.assert_close(found.center[0, 0][beside], without.center[0, 0][beside])
    assert (found.variance[0, 0, :, x > 10.0] == 1.0).all()
