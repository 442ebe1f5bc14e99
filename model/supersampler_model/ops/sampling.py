"""The sampling grid of display pixels in the render-size input, and separable resampling.

Every image is (1, channels, height, width). The grid is DESIGN.md section 3: display pixel p looks at
(p + 0.5) / r - 0.5 - jitter in the render-size input, per axis, with r = display / render; its previous
position is p + r * motion in display pixels. align_corners is False everywhere.
"""

from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.size import Size

Kernel = Callable[[Tensor], Tensor]
"""Weight of a sample at a distance, elementwise."""
WINDOW = 9
"""Samples in a learned kernel: a 3x3 neighbourhood."""
MIN_WEIGHT = 1e-3
"""Sum of weights below which no sample of a neighbourhood is usable."""


class Grid(NamedTuple):
    """Positions of the display pixels in the render-size input, and their nearest samples, per axis."""

    x: Tensor  # (W,) render pixels, 0 is the centre of sample 0
    y: Tensor  # (H,)
    column: Tensor  # (W,) int64, nearest sample
    row: Tensor  # (H,)
    left: Tensor  # (W,) int64, first of the two samples around each pixel
    top: Tensor  # (H,)


class Extent(NamedTuple):
    """Extent of a display in render pixels: the render size, or fractional for a crop of a display."""

    width: float
    height: float


class View(NamedTuple):
    """Mapping from a display, or a crop of one in training, to render-size inputs."""

    display: Size
    extent: Extent | Size
    jitter: Tensor  # (1, 2) render pixels

    def to_render(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Positions in display pixels as positions in render pixels."""
        return (
            (x + 0.5) * self.extent.width / self.display.width - 0.5 - self.jitter[0, 0],
            (y + 0.5) * self.extent.height / self.display.height - 0.5 - self.jitter[0, 1],
        )

    def grid(self, render: Size) -> Grid:
        """Grid of the display pixels in an input of size `render`."""
        x = positions(self.display.width, self.extent.width, self.jitter[0, :1])
        y = positions(self.display.height, self.extent.height, self.jitter[0, 1:])
        column, row = nearest(x, render.width), nearest(y, render.height)
        return Grid(x, y, column, row, nearest(x.floor(), render.width), nearest(y.floor(), render.height))


def grid_of(display: Size, render: Size, jitter: Tensor) -> Grid:
    """Grid of one whole frame; `jitter` is (1, 2) render pixels."""
    return View(display, render, jitter).grid(render)


class Taps(NamedTuple):
    """Taps of n display pixels along one axis: (n,) indices and (n,) weights per tap."""

    indices: list[Tensor]
    weights: list[Tensor]


def positions(display: int, render: float, jitter: Tensor) -> Tensor:
    """(display,) positions of the display pixels of one axis, in render pixels; `jitter` is (1,)."""
    pixel = torch.arange(display, dtype=torch.float32, device=jitter.device)
    return (pixel + 0.5) * render / display - 0.5 - jitter


def taps(position: Tensor, size: int, kernel: Kernel, *, reach: int = 2, scale: float = 1.0) -> Taps:
    """Read the `reach` samples to either side of each `position` along an axis, clamped at the border.

    The kernel is evaluated at the signed distance in render pixels times `scale`.
    """
    first = position.floor() - float(reach - 1)
    indices, weights = [], []
    for k in range(2 * reach):
        sample = first + float(k)
        indices.append(sample.long().clamp(0, size - 1))
        weights.append(kernel((sample - position) * scale))
    return Taps(indices, weights)


def nearest(position: Tensor, size: int) -> Tensor:
    """(n,) index of the sample nearest to each position, ties upwards."""
    return (position + 0.5).floor().long().clamp(0, size - 1)


def resample(image: Tensor, x: Taps, y: Taps) -> Tensor:
    """Sum `image` under the separable kernel of `x` and `y`: (1, c, h, w) -> (1, c, len y, len x)."""
    rows = sum_of([image.index_select(3, i) * w for i, w in zip(*x, strict=True)])
    return sum_of([rows.index_select(2, i) * w[:, None] for i, w in zip(*y, strict=True)])


def upsample(image: Tensor, grid: Grid, kernel: Kernel, scale: tuple[float, float] = (1.0, 1.0)) -> Tensor:
    """Sum `image` under `kernel` at every display pixel: (1, c, h, w) -> (1, c, H, W).

    The kernel is evaluated at distances in render pixels times `scale`, (x, y).
    """
    x = taps(grid.x, image.shape[3], kernel, scale=scale[0])
    return resample(image, x, taps(grid.y, image.shape[2], kernel, scale=scale[1]))


def normalised(sums: Tensor) -> Tensor:
    """Divide by the last channel, the sum of the weights: (1, c + 1, h, w) -> (1, c, h, w)."""
    return sums[:, :-1] / sums[:, -1:].clamp(min=1e-6)


def local_moments(
    color: Tensor, usable: Tensor, grid: Grid, sigma: float, least: float = MIN_WEIGHT
) -> tuple[Tensor, Tensor]:
    """E[c] and E[c^2], (1, 3, H, W) each, of the usable samples under a Gaussian at every display pixel.

    Where the sum of the Gaussian's weights is `least` or below, there is no sample: E[c^2] is 1.
    """
    window = upsample(torch.cat([color, color * color, usable], dim=1), grid, gaussian(sigma))
    moments, known = normalised(window), (window[:, 6:7] > least).float()
    return moments[:, :3], moments[:, 3:6] * known + (1.0 - known)


def neighbourhood_samples(samples: Tensor, grid: Grid, sigma: float) -> list[Tensor]:
    """Gather the 3x3 samples around each display pixel's nearest one, with Gaussian weights.

    Args:
        samples: (1, 4, h, w) colour, and 1 where it is usable.
        grid: of the display.
        sigma: of the Gaussian, render pixels.

    Returns:
        WINDOW tensors (1, 4, H, W), row by row: colour and weight.
    """
    height, width = samples.shape[2], samples.shape[3]
    around = []
    for down in (-1, 0, 1):
        row = grid.row + down
        rows = samples.index_select(2, row.clamp(0, height - 1))
        vertical = gaussian(sigma)(row - grid.y)[:, None]
        for across in (-1, 0, 1):
            column = grid.column + across
            sample = rows.index_select(3, column.clamp(0, width - 1))
            weight = sample[:, 3:] * (vertical * gaussian(sigma)(column - grid.x) + 1e-4)
            around.append(torch.cat([sample[:, :3], weight], dim=1))
    return around


def weighed(window: list[Tensor], kernel: Tensor, otherwise: Tensor) -> Tensor:
    """Mean (1, 3, H, W) of neighbourhood samples under a learned kernel.

    Args:
        window: from `neighbourhood_samples`.
        kernel: (1, WINDOW, H, W) logarithms of factors to the Gaussian weights.
        otherwise: (1, 3, H, W) the result where no sample is usable.
    """
    weights = [s[:, 3:] * kernel[:, i : i + 1].exp() for i, s in enumerate(window)]
    total = sum_of(weights)
    color = sum_of([s[:, :3] * w for s, w in zip(window, weights, strict=True)]) / total.clamp(min=1e-12)
    return torch.where(total > 1e-9, color, otherwise)


def pick(image: Tensor, grid: Grid) -> Tensor:
    """Read the sample nearest to each display pixel: (1, c, h, w) -> (1, c, H, W)."""
    return image.index_select(3, grid.column).index_select(2, grid.row)


def pick_first(image: Tensor, grid: Grid) -> Tensor:
    """Read the upper left of the four samples around each display pixel."""
    return image.index_select(3, grid.left).index_select(2, grid.top)


def sum_of(terms: list[Tensor]) -> Tensor:
    """Left-to-right sum, so that torch, ONNX and the CPU kernels add in one order."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def linear(distance: Tensor) -> Tensor:
    """Tent: bilinear interpolation."""
    return (1.0 - distance.abs()).clamp(min=0.0)


def catmull_rom(distance: Tensor) -> Tensor:
    """Catmull-Rom cubic (a = -0.5): interpolates, reproduces quadratics, support 2."""
    d = distance.abs()
    near = (1.5 * d - 2.5) * d * d + 1.0
    far = ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0
    return torch.where(d < 1.0, near, torch.where(d < 2.0, far, torch.zeros_like(d)))


def gaussian(sigma: float) -> Kernel:
    """Gaussian of height one."""
    return lambda distance: (distance * distance * (-0.5 / (sigma * sigma))).exp()


def neighbours_2x2(image: Tensor) -> list[Tensor]:
    """Each pixel and its right, lower and lower right neighbour, edges repeated: four (1, c, h, w)."""
    right = torch.cat([image[..., 1:], image[..., -1:]], dim=3)
    return [image, right, *(torch.cat([i[:, :, 1:], i[:, :, -1:]], dim=2) for i in (image, right))]


def neighbours_3x3(image: Tensor) -> list[Tensor]:
    """The nine 3x3 neighbours of every pixel, edges repeated, row by row; the fifth is `image` itself."""
    wide = torch.cat([image[..., :1], image, image[..., -1:]], dim=3)
    tall = torch.cat([wide[:, :, :1], wide, wide[:, :, -1:]], dim=2)
    h, w = image.shape[2], image.shape[3]
    return [tall[:, :, dy : dy + h, dx : dx + w] for dy in range(3) for dx in range(3)]


def channels_of(image: Tensor) -> list[Tensor]:
    """(n, c, h, w) as c images of one channel."""
    return list(image.split_with_sizes([1] * image.shape[1], dim=1))


def extreme(image: Tensor, choose: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    """Minimum or maximum (`choose`) over 3x3."""
    return reduce(choose, neighbours_3x3(image))


def blurred(image: Tensor) -> Tensor:
    """Mean over 3x3."""
    return sum_of(neighbours_3x3(image)) / 9.0
