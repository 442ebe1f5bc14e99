"""Arrays as kernels see them."""

from ctypes import addressof, c_char
from typing import Any

import numpy as np
from numpy.typing import NDArray

LINE = 64
"""Bytes of a line of the processor's caches."""


def address(array: NDArray[Any]) -> int:
    """Where an array's values are, for kernels; whoever calls keeps the array."""
    if not array.flags.c_contiguous:
        raise ValueError("not C-contiguous")
    if array.flags.writeable and array.size:
        return addressof(c_char.from_buffer(array))  # type: ignore[arg-type]  # a quarter of the time of the other way
    return int(array.ctypes.data)


def aligned(shape: tuple[int, ...], dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Zeros that begin where a line of the processor's caches does, before at least one line of room.

    No other array shares a line with them, so no other thread writes to one of theirs.
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.zeros(size + 2 * LINE, np.uint8)
    first = -room.ctypes.data % LINE
    return room[first : first + size].view(dtype).reshape(shape)
