"""Sizes of images: (width, height), symbolic while a graph is exported."""

from typing import NamedTuple

import torch
from torch import Tensor


class Size(NamedTuple):
    """Width and height of an image."""

    width: int
    height: int


def render_size_of(image: Tensor) -> Size:
    """Size of an NCHW tensor."""
    return Size(image.shape[3], image.shape[2])


def half_of(size: Size) -> Size:
    """Size of an image whose pixels each hold 2x2 pixels, rounded up."""
    return Size((size.width + 1) // 2, (size.height + 1) // 2)


def display_size_of(display_size: Tensor) -> Size:
    """Read (width, height) from the int64 input as sizes that the exporter can trace."""
    width, height = int(display_size[0].item()), int(display_size[1].item())
    torch._check(width >= 1)  # type: ignore[no-untyped-call]
    torch._check(height >= 1)  # type: ignore[no-untyped-call]
    return Size(width, height)
