"""Windows of pixels: neighbours, minima, maxima and sums over them, channels of an image.

Every image is (1, channels, height, width). Beyond an edge, its pixels are repeated.
"""

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.ops.size import Size, render_size_of


def neighbours_2x2(image: Tensor) -> list[Tensor]:
    """Each pixel and its right, lower and lower right neighbour, edges repeated: four (1, c, h, w)."""
    right = shifted(image, 1, 0)
    return [image, right, shifted(image, 0, 1), shifted(right, 0, 1)]


def neighbours_3x3(image: Tensor) -> list[Tensor]:
    """The nine 3x3 neighbours of every pixel, edges repeated, row by row; the fifth is `image` itself."""
    tall, h, w = padded_3x3(image), image.shape[2], image.shape[3]
    return [tall[:, :, dy : dy + h, dx : dx + w] for dy in range(3) for dx in range(3)]


def pick_rows(image: Tensor, index: Tensor) -> Tensor:
    """Read rows at indices (n, m): (1, c, h, w) -> (1, c, n, m, w)."""
    channels, width = image.shape[1], image.shape[3]
    return image.index_select(2, index.reshape(-1)).reshape(1, channels, *index.shape, width)


def pick_columns(image: Tensor, index: Tensor) -> Tensor:
    """Read columns: (1, c, h, w) -> (1, c, h, n).

    Transposed, so that ONNX Runtime copies whole rows: along the last axis it copies one number at a time.
    """
    return image.transpose(2, 3).index_select(2, index).transpose(2, 3)


def repeated(image: Tensor, size: Size) -> Tensor:
    """Repeat the last row and column of the upper left part of a size over the rest of the image."""
    for axis, extent in ((2, size.height), (3, size.width)):
        index = torch.arange(image.shape[axis], device=image.device).clamp(max=extent - 1)
        image = image.index_select(axis, index)
    return image


def padded_3x3(image: Tensor, size: Size | None = None) -> Tensor:
    """Repeat the edges by one pixel: (1, c, h, w) -> (1, c, h + 2, w + 2).

    With a `size`, the edges are those of an image of that size in the upper left.
    """
    width, height = size or render_size_of(image)
    for axis, extent in ((2, height), (3, width)):
        index = torch.arange(-1, image.shape[axis] + 1, device=image.device).clamp(0, extent - 1)
        image = image.index_select(axis, index)
    return image


def channels_of(image: Tensor) -> list[Tensor]:
    """(n, c, h, w) as c images of one channel."""
    return list(image.split_with_sizes([1] * image.shape[1], dim=1))


def maximum_3x3(image: Tensor) -> Tensor:
    """Maximum over 3x3."""
    return F.max_pool2d(image, 3, 1, 1)


def minimum_3x3(image: Tensor) -> Tensor:
    """Minimum over 3x3."""
    return -F.max_pool2d(-image, 3, 1, 1)


def blurred(image: Tensor, size: Size | None = None) -> Tensor:
    """Mean over 3x3, edges repeated; `size`: see `padded_3x3`."""
    return window_sum(padded_3x3(image, size), 3) / 9.0


def window_sum(image: Tensor, size: int, padding: int = 0) -> Tensor:
    """Sum of each channel over windows of `size` pixels a side; zeros are around the image."""
    channels = image.shape[1]
    ones = image.new_ones(channels, 1, size, size)
    return F.conv2d(image, ones, padding=padding, groups=channels)


def shifted(image: Tensor, across: int, down: int, size: Size | None = None) -> Tensor:
    """Each pixel's neighbour at an offset along one axis, edges repeated; `size`: see `padded_3x3`."""
    width, height = size or render_size_of(image)
    axis, offset, extent = (3, across, width) if across else (2, down, height)
    index = (torch.arange(image.shape[axis], device=image.device) + offset).clamp(0, extent - 1)
    return pick_columns(image, index) if across else image.index_select(2, index)


def cut(tensor: Tensor, axis: int, extent: int) -> Tensor:
    """Return the tensor with another extent along an axis: cut, or its last entry repeated."""
    index = torch.arange(extent, device=tensor.device).clamp(max=tensor.shape[axis] - 1)
    return pick_columns(tensor, index) if axis == 3 else tensor.index_select(axis, index)


def means_of(image: Tensor, side: int) -> Tensor:
    """Mean of each channel over squares of `side` pixels: (1, c, h, w) -> (1, c, h // side, w // side)."""
    channels = image.shape[1]
    weights = image.new_full((channels, 1, side, side), 1.0 / (side * side))
    return F.conv2d(image, weights, stride=side, groups=channels)


def spread(image: Tensor, side: int, size: Size) -> Tensor:
    """Repeat each pixel `side` times on both axes, up to a size."""
    for axis, extent in ((3, size.width), (2, size.height)):
        index = ((torch.arange(extent, device=image.device) + 0.5) / side).floor().long()
        image = image.index_select(axis, index)
    return image
