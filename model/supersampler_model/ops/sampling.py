"""The sampling grid of display pixels in the render-size input, and separable resampling.

Every image is (1, channels, height, width). Display pixel p reads the render-size input at
(p + 0.5) / r - 0.5 - jitter, per axis, with r = display / render; its previous position is p + r * motion in
display pixels (docs/contract.md). align_corners is False everywhere.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.methods.classifier_large.spec import LANCZOS_SCALE, LANCZOS_SLOPE, REACH, SHARPNESS
from supersampler.methods.constants import HIGHLIGHT_TONED, MIN_KERNEL_WEIGHT, MIN_WEIGHT
from supersampler_model.ops.color import TONED, bounded, dimming, inverse_tone, largest, min_divisor, tone
from supersampler_model.ops.images import Size, pick_columns, pick_rows, size_of

Kernel = Callable[[Tensor], Tensor]
"""Weight of a sample at a distance, elementwise."""
BLOCK = 16
"""Outputs that `resample` sums by one matrix product."""
ALIGNED = 16
"""Multiple of display pixels to which a grid may be extended: networks then need no padding of their own."""
WINDOW = 9
"""Samples in a learned kernel: a 3x3 neighbourhood."""


class Bands(NamedTuple):
    """Weights of resampling along one axis: in blocks of BLOCK outputs, each of `reach` samples.

    All samples of a block are gathered once, and a matrix product sums them. This moves fewer bytes than one
    gather for each tap.
    """

    indices: Tensor  # (blocks, reach) int64, samples of each block
    weights: Tensor  # (blocks, BLOCK, reach)
    outputs: int | None  # None: all of the blocks

    @property
    def normalised(self) -> "Bands":
        """The weights divided by their sum."""
        return self._replace(weights=self.weights / self.weights.sum(dim=2, keepdim=True))


class GridAxis(NamedTuple):
    """The display pixels along one axis, and their positions in the render-size input."""

    pixel: Tensor  # (n,) int64 display pixel, ascending within the display
    position: Tensor  # (n,) render pixels, 0 is the centre of sample 0
    nearest: Tensor  # (n,) int64, nearest sample
    first: Tensor  # (n,) int64, first of the two samples around each pixel
    span: int  # samples that the positions of BLOCK neighbouring pixels span at most


class Grid(NamedTuple):
    """The display pixels and their positions in the render-size input."""

    x: GridAxis
    y: GridAxis
    aligned: bool  # whether both axes are multiples of ALIGNED

    def pick(self, image: Tensor) -> Tensor:
        """Read the sample nearest to each display pixel: (1, c, h, w) -> (1, c, H, W)."""
        return pick_columns(image, self.x.nearest).index_select(2, self.y.nearest)

    def pick_vectors(self, vectors: Tensor) -> Tensor:
        """Read as `pick` does, for vectors with their two channels last: (1, h, w, 2) -> (1, H, W, 2)."""
        return vectors.index_select(2, self.x.nearest).index_select(1, self.y.nearest)

    def pick_first(self, image: Tensor) -> Tensor:
        """Read the upper left of the four samples around each display pixel: (1, c, h, w) -> (1, c, H, W)."""
        return pick_columns(image, self.x.first).index_select(2, self.y.first)

    def pick_first_vectors(self, vectors: Tensor) -> Tensor:
        """Read as `pick_first` does, for vectors: (1, h, w, 2) -> (1, H, W, 2)."""
        return vectors.index_select(2, self.x.first).index_select(1, self.y.first)

    def at_pixels(self, image: Tensor) -> Tensor:
        """Read an image of display size at the pixels of the grid, which may extend beyond the display."""
        return pick_columns(image, self.x.pixel).index_select(2, self.y.pixel)

    def bands(
        self,
        render: Size,
        kernel: Kernel,
        *,
        reach: int = 2,
        scale: tuple[float, float] = (1.0, 1.0),
        inside: bool = False,
    ) -> tuple[Bands, Bands]:
        """Weigh the samples of an input of size `render` at the display pixels, per axis; see `bands`."""
        across, down = (
            bands(
                axis.position, size, axis.span, kernel,
                reach=reach, scale=factor, aligned=self.aligned, inside=inside,
            )
            for axis, size, factor in zip((self.x, self.y), render, scale, strict=True)
        )  # fmt: skip
        return across, down

    def upsample(self, image: Tensor, kernel: Kernel, scale: tuple[float, float] = (1.0, 1.0)) -> Tensor:
        """Sum `image` under `kernel` at every display pixel: (1, c, h, w) -> (1, c, H, W).

        The kernel is evaluated at distances in render pixels times `scale`, (x, y).
        """
        return resample(image, *self.bands(size_of(image), kernel, scale=scale))


class Extent(NamedTuple):
    """Extent of a display in render pixels: the render size, or fractional for a crop of a display."""

    width: float
    height: float


class View(NamedTuple):
    """Mapping from a display, or a crop of one in training, to render-size inputs."""

    display: Size
    extent: Extent | Size
    jitter: Tensor  # (1, 2) render pixels

    @property
    def ratio(self) -> tuple[float, float]:
        """Display pixels per render pixel, (x, y)."""
        return self.display.width / self.extent.width, self.display.height / self.extent.height

    def to_render(self, position: Tensor) -> Tensor:
        """Convert positions (1, H, W, 2) in display pixels to render pixels."""
        scale = pair(
            position, self.extent.width / self.display.width, self.extent.height / self.display.height
        )
        return position * in_row(scale, position) + in_row(0.5 * scale - 0.5 - self.jitter[0], position)

    def grid(self, render: Size, *, aligned: bool = False) -> Grid:
        """Return the grid of the display pixels in an input of size `render`.

        Args:
            render: (width, height) of the input.
            aligned: extend the grid to multiples of ALIGNED, see `extended`.
        """

        def axis(display: int, extent: float, samples: int, jitter: Tensor) -> GridAxis:
            pixel = (
                extended(display, jitter.device) if aligned else torch.arange(display, device=jitter.device)
            )
            position = positions(pixel, display, extent, jitter)
            first = nearest(position.floor(), samples)
            return GridAxis(pixel, position, nearest(position, samples), first, span(extent, display))

        jitters = self.jitter[0, :1], self.jitter[0, 1:]
        x, y = map(axis, self.display, self.extent, render, jitters)
        return Grid(x, y, aligned)


def grid_of(display: Size, render: Size, jitter: Tensor) -> Grid:
    """Return the grid of one whole frame; `jitter` is (1, 2) render pixels."""
    return View(display, render, jitter).grid(render)


def pair(like: Tensor, x: float, y: float) -> Tensor:
    """Return two numbers as (2,); they may be symbolic while a graph is exported."""
    one = like.new_ones(1)
    return torch.cat([one * x, one * y])


def in_row(values: Tensor, like: Tensor) -> Tensor:
    """Repeat the values of x and y, (2,), as (W, 2): broadcasting of two values to (1, H, W, 2) is slow."""
    return values.expand(like.shape[2], 2)


def extended(size: int, device: torch.device) -> Tensor:
    """Return the pixels of an axis, (n,) int64, extended to a multiple of ALIGNED.

    The last pair of pixels is repeated, from an even pixel on, so that packing 2x2 pixels of the result
    repeats the last packed pixel.
    """
    pairs = (size + ALIGNED - 1) // ALIGNED * (ALIGNED // 2)
    first = 2 * torch.arange(pairs, device=device).clamp(max=(size + 1) // 2 - 1)
    return (first[:, None] + torch.arange(2, device=device)).reshape(-1).clamp(max=size - 1)


def positions(pixel: Tensor, display: int, render: float, jitter: Tensor) -> Tensor:
    """Return the positions, (n,) render pixels, of pixels (n,) of an axis of the display.

    `display` is the extent of the axis, `render` its extent in render pixels, `jitter` (1,) render pixels.
    """
    return (pixel + 0.5) * render / display - 0.5 - jitter


def nearest(position: Tensor, size: int) -> Tensor:
    """Return the index of the sample nearest to each position, (n,), ties upwards."""
    return (position + 0.5).floor().long().clamp(0, size - 1)


def span(size: float, outputs: float) -> int:
    """Return the number of samples that the positions of BLOCK neighbouring outputs span at most.

    `size` is the number of samples of the axis, fractional for a crop, `outputs` the number of positions.
    """
    whole = (BLOCK - 1) * size // outputs
    return (int(whole) if isinstance(whole, float) else whole) + 3  # one of them for rounding errors


def bands(
    position: Tensor,
    size: int,
    spanned: int,
    kernel: Kernel,
    *,
    reach: int = 2,
    scale: float = 1.0,
    aligned: bool = False,
    inside: bool = False,
) -> Bands:
    """Weigh the `reach` samples to either side of each `position` along an axis, clamped at the border.

    Args:
        position: (n,) in samples; in each BLOCK, the first one is the smallest.
        size: samples of the axis.
        spanned: from `span`.
        kernel: evaluated at the signed distance in samples times `scale`.
        reach: reach of the kernel, samples.
        scale: scale of the distances.
        aligned: whether n is a multiple of BLOCK.
        inside: whether samples beyond the border have a weight of 0; otherwise the border is repeated.
    """
    count = None if aligned else position.shape[0]
    if count is not None:
        blocks = (count + BLOCK - 1) // BLOCK + 1  # never 1, which the exporter would make a constant
        whole = torch.arange(blocks * BLOCK, device=position.device).clamp(max=count - 1)
        position = position.index_select(0, whole)
    at = position.reshape(-1, BLOCK, 1)
    first = at[:, :1].floor() - float(reach - 1)
    sample = first + torch.arange(spanned + 2 * reach - 1, device=position.device)  # (blocks, 1, reach)
    distance, steps = sample - at, sample - at.floor()
    near = (steps >= 1.0 - reach) & (steps <= float(reach))
    if inside:
        near = near & (sample >= 0.0) & (sample <= size - 1.0)
    weights = torch.where(near, kernel(distance * scale), 0.0)
    return Bands(sample.squeeze(1).long().clamp(0, size - 1), weights, count)


def resample(image: Tensor, x: Bands, y: Bands) -> Tensor:
    """Sum `image` under the separable kernel of `x` and `y`: (1, c, h, w) -> (1, c, len y, len x).

    All values must be finite: samples out of the kernel's reach are multiplied by 0.
    """
    return _resample_rows(_resample_rows(image.transpose(2, 3), x).transpose(2, 3), y)


def _resample_rows(image: Tensor, y: Bands) -> Tensor:
    rows = pick_rows(image, y.indices)
    _, channels, blocks, _, width = rows.shape
    sums = (y.weights.to(image.dtype) @ rows).reshape(1, channels, blocks * BLOCK, width)
    if y.outputs is None:
        return sums
    # the exporter cannot prove that a slice would fit
    return sums.index_select(2, torch.arange(y.outputs, device=image.device))


def downsample(image: Tensor, display: Size, exposure: Tensor) -> Tensor:
    """Downsample an image that is larger than the display by a Lanczos filter on toned colours.

    Args:
        image: (1, 3, H', W') linear RGB, at most 1.4 times the display, per axis.
        display: (width, height) of the result.
        exposure: (1,) > 0. As colours are toned, the dark sides of bright edges stay dark. A highlight is
            at most as bright as the brightest of the four pixels around it.

    Returns:
        (1, 3, H, W) linear RGB.
    """

    def position_of(size: int, outputs: int) -> Tensor:
        return (torch.arange(outputs, device=image.device) + 0.5) * size / outputs - 0.5

    def axis(size: int, outputs: int) -> Bands:
        position = position_of(size, outputs)
        scale = SHARPNESS * outputs / size
        return bands(position, size, span(size, outputs), lanczos, reach=REACH, scale=scale).normalised

    def around(size: int, outputs: int) -> list[Tensor]:
        first = position_of(size, outputs).floor().long()
        return [(first + step).clamp(0, size - 1) for step in range(2)]

    across, down = map(axis, size_of(image), display)
    exposed = tone(image * exposure)
    toned = resample(exposed, across, down)
    columns, rows = map(around, size_of(image), display)
    above, below = (largest(exposed).index_select(2, row) for row in rows)
    left, right = (pick_columns(torch.maximum(above, below), column) for column in columns)
    toned = toned * dimming(toned, torch.maximum(left, right).clamp(min=HIGHLIGHT_TONED))
    return bounded(inverse_tone(toned.clamp(0.0, TONED[torch.float32])) / exposure)


def normalised(sums: Tensor) -> Tensor:
    """Divide by the last channel, the sum of the weights: (1, c + 1, h, w) -> (1, c, h, w)."""
    values, weight = sums.split_with_sizes([sums.shape[1] - 1, 1], dim=1)
    return values / weight.clamp(min=min_divisor(weight, 1e-6))


def local_moments(color: Tensor, usable: Tensor, grid: Grid, sigma: float) -> tuple[Tensor, Tensor, Tensor]:
    """Return E[c] and E[c^2], (1, 3, H, W), of the usable samples under a Gaussian at every display pixel.

    The third result is the sum of the Gaussian's weights. Where it is MIN_WEIGHT or below, E[c^2] is 1.
    """
    window = grid.upsample(torch.cat([color, color * color, usable], dim=1), gaussian(sigma))
    first, second, weight = window.split_with_sizes([3, 3, 1], dim=1)
    total = weight.clamp(min=1e-6)
    return first / total, torch.where(weight > MIN_WEIGHT, second / total, 1.0), weight


class Window(NamedTuple):
    """The 3x3 samples around each display pixel's nearest one, row by row."""

    color: Tensor  # (1, 3, WINDOW, H, W)
    weight: Tensor  # (1, WINDOW, H, W) Gaussian, 0 where a sample is not usable

    def mean(self, kernel: Tensor, otherwise: Tensor) -> Tensor:
        """Average the samples under a learned kernel.

        Args:
            kernel: (1, WINDOW, H, W) logarithms of factors to the weights.
            otherwise: (1, 3, H, W) the result where no sample is usable.
        """
        weights = self.weight * kernel.exp()
        total = weights.sum(dim=1, keepdim=True)
        minimum = min_divisor(total, 1e-9)
        color = (self.color * weights).sum(dim=2) / total.clamp(min=minimum)
        return torch.where(total > minimum, color, otherwise)


def neighbourhood_samples(samples: Tensor, grid: Grid, sigma: float) -> Window:
    """Gather the 3x3 samples around each display pixel's nearest one, with Gaussian weights.

    `samples`, (1, 4, h, w), are colours, and 1 where they are usable, else 0. `sigma` is in render pixels.
    """
    width, height = size_of(samples)
    row, column = (
        axis.nearest + torch.arange(-1, 2, device=samples.device)[:, None] for axis in (grid.y, grid.x)
    )
    color, usable = _around(samples, row.clamp(0, height - 1), column.clamp(0, width - 1))
    by_row = torch.arange(WINDOW, device=samples.device)
    rows = gaussian(sigma)(row - grid.y.position).index_select(0, by_row // 3)
    columns = gaussian(sigma)(column - grid.x.position).index_select(0, by_row % 3)
    rows = torch.stack([rows, 0.0 * rows + MIN_KERNEL_WEIGHT], dim=2).to(samples.dtype)
    columns = torch.stack([columns, 0.0 * columns + 1.0], dim=1).to(samples.dtype)
    near = rows @ columns  # the product of both Gaussians, plus MIN_KERNEL_WEIGHT
    return Window(color, usable[:, 0] * near)


def _around(samples: Tensor, row: Tensor, column: Tensor) -> tuple[Tensor, Tensor]:
    """Read 3x3 samples, at rows (3, H) and columns (3, W), as (1, 3, 9, H, W) and (1, 1, 9, H, W)."""
    height = samples.shape[2]
    across = pick_rows(samples.transpose(2, 3), column)  # (1, 4, 3, W, h)
    across = across.transpose(3, 4).reshape(1, 4, 3 * height, -1)
    by_row = torch.arange(WINDOW, device=samples.device)
    place = row.index_select(0, by_row // 3) + height * (by_row % 3)[:, None]
    color, usable = (pick_rows(part, place) for part in across.split_with_sizes([3, 1], dim=1))
    return color, usable


def linear(distance: Tensor) -> Tensor:
    """Tent: bilinear interpolation."""
    return (1.0 - distance.abs()).clamp(min=0.0)


def catmull_rom(distance: Tensor) -> Tensor:
    """Catmull-Rom cubic (a = -0.5): interpolates, reproduces quadratics, support 2."""
    d = distance.abs()
    near = (1.5 * d - 2.5) * d * d + 1.0
    far = ((-0.5 * d + 2.5) * d - 4.0) * d + 2.0
    return torch.where(d < 1.0, near, torch.where(d < 2.0, far, 0.0))


def gaussian(sigma: float) -> Kernel:
    """Gaussian of height one."""
    return lambda distance: (distance * distance * (-0.5 / (sigma * sigma))).exp()


def lanczos(distance: Tensor) -> Tensor:
    """Lanczos filter of two lobes, support 2, as the polynomial that FSR uses in place of sines."""
    squared = (distance * distance).clamp(max=4.0)
    base, window = LANCZOS_SLOPE * squared - 1.0, 0.25 * squared - 1.0
    return (LANCZOS_SCALE * base * base - (LANCZOS_SCALE - 1.0)) * window * window
