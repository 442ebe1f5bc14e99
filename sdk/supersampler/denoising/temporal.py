"""`TemporalFilter`: the mean of a frame and its neighbours along their motion, by the CPU library.

The filter's definition, in torch, is supersampler_model/denoising/filter.py.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import Array as CArray
from ctypes import addressof, c_void_p
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ieee_arithmetic
from supersampler.backends.cpu.library import TemporalData, TemporalFrame, cpu_library
from supersampler.denoising.spec import DEFAULT_SAMPLES
from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF

_BAND = 32
"""Rows of a task of a thread: those of a tile of the library."""


@dataclass(eq=False)
class WindowFrame:
    """A frame as the filter reads it: packed arrays of float32.

    Attributes:
        color: (h, w, 4) linear RGB, denoised, and 1; 0 in all four where a sample is missing.
        guides: (h, w, 8) albedo, 0, normal, 0; all 0 where there are none.
        to_previous, to_next: (h, w, 2) pixels, from `nearest_motion`; None at a cut.
        aovs: arrays (h, w, 4), which hold the AOVs in order; the last one is filled up with zeros.
        noisy: (h, w, 4) as `color`, before denoising; it is averaged in place of `color`, by the weights
            OF_NOISY.
    """

    color: Float32
    guides: Float32
    to_previous: Float32 | None = None
    to_next: Float32 | None = None
    aovs: Sequence[Float32] = field(default_factory=list)
    noisy: Float32 | None = None


class TemporalFilter:
    """Averages frames and their neighbours; a context, which ends its threads.

    Args:
        threads: threads that compute; 0 is one per core.
    """

    def __init__(self, *, threads: int = 0) -> None:
        self._threads = ThreadPoolExecutor(threads or os.cpu_count() or 1, thread_name_prefix="denoise")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown()

    @ieee_arithmetic
    def filter(
        self,
        frame: WindowFrame,
        previous: Sequence[WindowFrame],
        following: Sequence[WindowFrame],
        exposure: float = 1.0,
        samples: float = DEFAULT_SAMPLES,
    ) -> tuple[Float32, list[Float32]]:
        """Return the mean colour and the sum of the weights (h, w, 4), and the means of the AOVs' arrays.

        Args:
            frame: the frame, whose own weight is 1.
            previous: frames before it, the nearest one first; at most REACH are read.
            following: frames after it, the nearest one first; at most REACH are read.
            exposure: > 0, multiplies colour where colours are compared.
            samples: > 0, samples per pixel of the renderer.
        """
        height, width, _ = frame.color.shape
        image = np.empty((height, width, 4), np.float32)
        aovs = [np.empty((height, width, 4), np.float32) for _ in frame.aovs]
        window = (frame, *previous, *following)
        tables = [_addresses(item.aovs) for item in window]
        records = (TemporalFrame * len(window))(*map(_record, window, tables))
        outputs = _addresses(aovs)

        def compute(first: int) -> None:
            work = TemporalData(
                width, height, records, len(previous), len(following), len(aovs), exposure, samples,
                first, min(first + _BAND, height), image.ctypes.data, addressof(outputs),
            )  # fmt: skip
            cpu_library().call("ss_filter_temporal", work)

        list(self._threads.map(compute, range(0, height, _BAND)))
        return image, aovs


def _addresses(arrays: Sequence[NDArray[Any]]) -> CArray[c_void_p]:
    return (c_void_p * max(1, len(arrays)))(*(array.ctypes.data for array in arrays))


def _record(frame: WindowFrame, aovs: CArray[c_void_p]) -> TemporalFrame:
    previous, following = (
        None if step is None else step.ctypes.data for step in (frame.to_previous, frame.to_next)
    )
    noisy = None if frame.noisy is None else frame.noisy.ctypes.data
    return TemporalFrame(
        frame.color.ctypes.data, noisy, frame.guides.ctypes.data, previous, following, addressof(aovs)
    )


def packed_color(color: NDArray[Any], factor: float = 1.0) -> Float32:
    """Return colour (h, w, 3) times a factor as `WindowFrame.color`; values are clamped to [0, MAX_HALF]."""
    packed = np.ones((*color.shape[:2], 4), np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        values = np.asarray(color, np.float32)
        values = values if factor == 1.0 else values * np.float32(factor)
    for channel in range(3):  # faster than all at once
        np.clip(values[..., channel], 0.0, MAX_HALF, out=packed[..., channel])
    packed[np.isnan(packed[..., 0] + packed[..., 1] + packed[..., 2])] = 0.0
    return packed


def packed_guides(albedo: NDArray[Any] | None, normal: NDArray[Any] | None, size: tuple[int, int]) -> Float32:
    """Return albedo and normal (h, w, 3), without NaN, as `WindowFrame.guides`. `size` is (h, w)."""
    packed = np.zeros((*size, 8), np.float32)
    for first, guide in ((0, albedo), (4, normal)):
        if guide is not None:
            for channel in range(3):  # faster than all at once
                np.clip(guide[..., channel], -1.0, 1.0, out=packed[..., first + channel])
    return packed


def packed_aovs(aovs: NDArray[Any] | None) -> list[Float32]:
    """Return AOVs (h, w, k) as `WindowFrame.aovs`; values that are not finite become 0."""
    if aovs is None:
        return []
    height, width, count = aovs.shape
    packed = [np.zeros((height, width, 4), np.float32) for _ in range(0, count, 4)]
    for group, array in enumerate(packed):
        part = aovs[..., 4 * group : 4 * group + 4]
        array[..., : part.shape[2]] = np.nan_to_num(part, nan=0.0, posinf=0.0, neginf=0.0)
    return packed


@ieee_arithmetic
def nearest_motion(depth: Float32, motion: NDArray[Any]) -> Float32:
    """Return the motion of the closest of the 3x3 pixels around each: edges move with the foreground.

    Args:
        depth: (h, w) reversed: larger is closer. Negative values, NaN and infinity count as far away.
        motion: (h, w, 2) pixels.
    """
    is_known = np.isfinite(depth) & (depth >= 0.0)
    known = np.where(is_known, depth, np.float32(-1.0)).astype(np.float32, copy=False)
    source = np.ascontiguousarray(motion, np.float32)
    nearest = np.empty_like(source)
    height, width = depth.shape
    cpu_library().call(
        "ss_nearest_motion", known.ctypes.data, source.ctypes.data, width, height, nearest.ctypes.data
    )
    return nearest
