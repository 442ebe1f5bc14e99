"""Sizes, channels, neighbours and windows of images.

Every image is (1, channels, height, width). Pixels at the edges are repeated beyond them.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F


class Size(NamedTuple):
    """Width and height of an image; symbolic while a graph is exported."""

    width: int
    height: int


def size_of(image: Tensor) -> Size:
    """Return the size of an image."""
    return Size(image.shape[3], image.shape[2])


def half_of(size: Size) -> Size:
    """Return the size of an image whose pixels each hold 2x2 pixels, rounded up."""
    return Size((size.width + 1) // 2, (size.height + 1) // 2)


def display_size_of(display_size: Tensor) -> Size:
    """Read (width, height) from the int64 input as sizes that the exporter can trace."""
    width, height = int(display_size[0].item()), int(display_size[1].item())
    torch._check(width >= 1)  # type: ignore[no-untyped-call]
    torch._check(height >= 1)  # type: ignore[no-untyped-call]
    return Size(width, height)


def channels_of(image: Tensor) -> list[Tensor]:
    """Split (n, c, h, w) into c images of one channel."""
    return list(image.split_with_sizes([1] * image.shape[1], dim=1))


def sum_of(terms: list[Tensor]) -> Tensor:
    """Add from left to right, so that torch, ONNX and the CPU kernels add in one order."""
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


def pick_rows(image: Tensor, index: Tensor) -> Tensor:
    """Read rows at indices (n, m): (1, c, h, w) -> (1, c, n, m, w)."""
    channels, width = image.shape[1], image.shape[3]
    return image.index_select(2, index.reshape(-1)).reshape(1, channels, *index.shape, width)


def pick_columns(image: Tensor, index: Tensor) -> Tensor:
    """Read columns: (1, c, h, w) -> (1, c, h, n).

    The image is transposed, because ONNX Runtime copies whole rows, but columns one number at a time.
    """
    return image.transpose(2, 3).index_select(2, index).transpose(2, 3)


def fit_axis(tensor: Tensor, axis: int, extent: int) -> Tensor:
    """Cut a tensor to an extent along an axis, or repeat its last entry up to it."""
    index = torch.arange(extent, device=tensor.device).clamp(max=tensor.shape[axis] - 1)
    return pick_columns(tensor, index) if axis == 3 else tensor.index_select(axis, index)


def fit(image: Tensor, width: int, height: int) -> Tensor:
    """Cut an image to a size, or repeat its last row and column up to it."""
    return fit_axis(fit_axis(image, 2, height), 3, width)


def cut_to(image: Tensor, size: Size) -> Tensor:
    """Return the upper left part of an image."""
    return image[:, :, : size.height, : size.width]


def repeat_edges(image: Tensor, size: Size) -> Tensor:
    """Replace all but the upper left part of an image by the last row and column of that part."""
    for axis, extent in ((2, size.height), (3, size.width)):
        index = torch.arange(image.shape[axis], device=image.device).clamp(max=extent - 1)
        image = image.index_select(axis, index)
    return image


def resize_nearest(image: Tensor, size: Size) -> Tensor:
    """Resample an image by nearest pixels: the identity at its own size."""
    for axis, extent in ((3, size.width), (2, size.height)):
        own, pixel = image.shape[axis], torch.arange(extent, device=image.device)
        position = (pixel + 0.5) * own / extent - 0.5
        image = image.index_select(axis, (position + 0.5).floor().long().clamp(0, own - 1))
    return image


def shifted(image: Tensor, across: int, down: int) -> Tensor:
    """Return each pixel's neighbour at an offset along one axis."""
    axis, offset = (3, across) if across else (2, down)
    extent = image.shape[axis]
    index = (torch.arange(extent, device=image.device) + offset).clamp(0, extent - 1)
    return pick_columns(image, index) if across else image.index_select(2, index)


def neighbours_2x2(image: Tensor) -> list[Tensor]:
    """Return each pixel and its right, lower and lower right neighbour: four (1, c, h, w)."""
    right = shifted(image, 1, 0)
    return [image, right, shifted(image, 0, 1), shifted(right, 0, 1)]


def padded_3x3(image: Tensor, size: Size | None = None) -> Tensor:
    """Repeat the edges by one pixel: (1, c, h, w) -> (1, c, h + 2, w + 2).

    With a `size`, the upper left part of that size is the image whose edges are repeated.
    """
    width, height = size or size_of(image)
    for axis, extent in ((2, height), (3, width)):
        index = torch.arange(-1, image.shape[axis] + 1, device=image.device).clamp(0, extent - 1)
        image = image.index_select(axis, index)
    return image


def neighbours_3x3(image: Tensor, size: Size | None = None) -> list[Tensor]:
    """Return the nine 3x3 neighbours of every pixel, row by row; `size`: see `padded_3x3`."""
    padded, (w, h) = padded_3x3(image, size), size_of(image)
    return [padded[:, :, dy : dy + h, dx : dx + w] for dy in range(3) for dx in range(3)]


def maximum_3x3(image: Tensor) -> Tensor:
    """Return the maximum over 3x3 pixels."""
    return F.max_pool2d(image, 3, 1, 1)


def minimum_3x3(image: Tensor) -> Tensor:
    """Return the minimum over 3x3 pixels."""
    return -F.max_pool2d(-image, 3, 1, 1)


def blurred(image: Tensor, size: Size | None = None) -> Tensor:
    """Return the mean over 3x3 pixels; `size`: see `padded_3x3`."""
    ones = image.new_ones(image.shape[1], 1, 3, 3)
    return F.conv2d(padded_3x3(image, size), ones, groups=image.shape[1]) / 9.0


def block_means(image: Tensor, side: int) -> Tensor:
    """Average each channel over squares of `side` pixels: (1, c, h, w) -> (1, c, h // side, w // side)."""
    channels = image.shape[1]
    weights = image.new_full((channels, 1, side, side), 1.0 / (side * side))
    return F.conv2d(image, weights, stride=side, groups=channels)


def spread(image: Tensor, side: int, size: Size) -> Tensor:
    """Repeat each pixel `side` times on both axes, up to a size."""
    for axis, extent in ((3, size.width), (2, size.height)):
        index = ((torch.arange(extent, device=image.device) + 0.5) / side).floor().long()
        image = image.index_select(axis, index)
    return image


def window_means(image: Tensor, side: int, size: Size | None = None) -> Tensor:
    """Replace each pixel by the mean of its square of `side` pixels; `size`: of the image, if known."""
    size = size or size_of(image)
    whole = fit(image, size.width + side - 1, size.height + side - 1)
    return spread(block_means(whole, side), side, size)
