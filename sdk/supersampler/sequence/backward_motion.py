"""Motion for a run over reversed frames: where each sample is in the next frame.

A renderer that writes it fills `Frame.motion_next`. Otherwise the next frame's motion, which leads back, is
scattered: each of its samples was at a known place in this frame. Of several that were at one pixel, the one
whose depth is nearest to the pixel's belongs to it. A pixel that none reached, because its surface is hidden
in the next frame or was magnified, takes the motion of the nearest pixels of its surface.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ieee_arithmetic
from supersampler.backends.cpu.kernel_loader import kernel_if_possible
from supersampler.backends.cpu.structs import pack
from supersampler.frame import Float32, Frame
from supersampler.sequence.kernels.structs import HIDDEN, OTHER_SURFACE, REACH, SAME_SURFACE, ScatterTables


@ieee_arithmetic
def reversed_frame(frame: Frame, following: Frame | None) -> Frame:
    """Return a frame as a run over reversed frames takes it: the following one is the previous one there.

    Args:
        frame: the frame.
        following: the next frame of the shot; None where the reversed run begins with `frame`.
    """
    if following is None:
        return replace(frame, motion=np.zeros((*frame.depth.shape, 2), np.float32), reset=True)
    return replace(frame, motion=motion_to_next(frame, following), reset=False)


@ieee_arithmetic
def motion_to_next(frame: Frame, following: Frame) -> Float32:
    """Return (h, w, 2) render pixels, next minus current: `frame.motion_next`, or scattered.

    Args:
        frame: the frame.
        following: the next frame; of another render size, too.
    """
    if frame.motion_next is not None:
        return np.asarray(frame.motion_next, np.float32)
    return scattered_motion(frame, following)


def scattered_motion(frame: Frame, following: Frame) -> Float32:
    """Return `frame.motion_next`, (h, w, 2) float32, computed from the motion of the next frame."""
    (width, height), (next_width, next_height) = frame.size, following.size
    scale = width / next_width, height / next_height
    shift = (
        (0.5 + following.jitter[0]) * scale[0] - (0.5 + frame.jitter[0]),
        (0.5 + following.jitter[1]) * scale[1] - (0.5 + frame.jitter[1]),
    )
    tables = ScatterTables(
        np.empty((height, width, 2), np.float32),
        np.empty((height, width), np.float32),
        np.ascontiguousarray(frame.depth),
        np.ascontiguousarray(following.motion, np.float32),
        np.ascontiguousarray(following.depth),
        *shift, *scale, width, height, next_width, next_height,
    )  # fmt: skip
    kernel = kernel_if_possible("sequence.kernels.scatter.scatter_motion")
    if kernel is None:
        scatter_motion_numpy(tables)
    else:
        kernel(pack(tables))
    return tables.motion


def scatter_motion_numpy(tables: ScatterTables) -> None:
    """Write the motion as the kernel does, without a compiler."""
    _scatter(tables)
    known = tables.mismatch < HIDDEN
    missing = ~known
    best = np.full(known.shape, np.inf, np.float32)  # distance in pixels, further apart on other surfaces
    filled = tables.motion.copy()
    for dy, dx in sorted(_OFFSETS, key=lambda o: o[0] ** 2 + o[1] ** 2):
        there = _shifted(known, dy, dx, fill=False)
        depth = _shifted(tables.depth, dy, dx, fill=0.0)
        other = _mismatch(tables.depth, depth) > SAME_SURFACE
        cost = np.float32(dy * dy + dx * dx) + np.where(other, np.float32(OTHER_SURFACE), np.float32(0))
        take = missing & there & (cost < best)
        best[take] = cost[take]
        filled[take] = _shifted(tables.motion, dy, dx, fill=0.0)[take]
    tables.motion[...] = filled


_OFFSETS = [(dy, dx) for dy in range(-REACH, REACH + 1) for dx in range(-REACH, REACH + 1) if dy or dx]


def _scatter(tables: ScatterTables) -> None:
    rows, columns = np.indices((tables.next_height, tables.next_width), np.float32)
    vectors = np.where(np.isfinite(tables.next_motion), tables.next_motion, np.float32(2e6))
    x = (columns + vectors[..., 0]) * np.float32(tables.scale_x) + np.float32(tables.shift_x)
    y = (rows + vectors[..., 1]) * np.float32(tables.scale_y) + np.float32(tables.shift_y)
    column, row = np.floor(x + np.float32(0.5)), np.floor(y + np.float32(0.5))
    inside = (column >= 0) & (column < tables.width) & (row >= 0) & (row < tables.height)
    place = row[inside].astype(np.intp) * tables.width + column[inside].astype(np.intp)
    mismatch = _mismatch(tables.depth.ravel()[place], tables.next_depth[inside])
    scale = np.array([tables.scale_x, tables.scale_y], np.float32)
    order = np.argsort(-mismatch, kind="stable")  # of several, the last one written is kept
    order = order[mismatch[order] <= SAME_SURFACE]
    tables.mismatch.fill(HIDDEN)
    tables.motion.fill(0.0)
    tables.mismatch.ravel()[place[order]] = mismatch[order]
    tables.motion.reshape(-1, 2)[place[order]] = (-vectors[inside] * scale)[order]


def _mismatch(a: Float32, b: Float32) -> Float32:
    """Return |a - b| / max(a, b), 0 where both are 0; HIDDEN where one is not finite."""
    larger = np.maximum(np.abs(a), np.abs(b))
    with np.errstate(invalid="ignore"):
        difference = np.abs(a - b) / np.maximum(larger, np.float32(1e-30))
    result: Float32 = np.where(np.isfinite(difference), difference, np.float32(HIDDEN)).astype(np.float32)
    return result


def _shifted(array: NDArray[Any], dy: int, dx: int, *, fill: float) -> NDArray[Any]:
    """Return `array` read at (row + dy, column + dx); `fill` outside."""
    height, width = array.shape[:2]
    result = np.full_like(array, fill)
    top, bottom = max(0, -dy), min(height, height - dy)
    left, right = max(0, -dx), min(width, width - dx)
    if top < bottom and left < right:
        result[top:bottom, left:right] = array[top + dy : bottom + dy, left + dx : right + dx]
    return result
