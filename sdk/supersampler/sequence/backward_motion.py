"""Motion for a run over reversed frames: where each sample is in the next frame.

A renderer that knows it fills `Frame.motion_next`. Otherwise the next frame's motion, which leads back, is
scattered: each of its samples was at a known position in this frame. If several were at one pixel, the one
with the nearest depth is used. A pixel that none reached, because its surface is occluded in the next frame
or was magnified, takes the motion of the nearest pixels of its surface.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ieee_arithmetic
from supersampler.backends.cpu.kernel_loader import kernel_if_possible
from supersampler.backends.cpu.structs import Floats, pack
from supersampler.frame import Float32, Frame

SAME_SURFACE = 0.1
"""Maximum difference of two depths of one surface in neighbouring frames, relative to the larger one."""
HIDDEN = 1e30
"""Mismatch of a pixel that no sample reached."""
REACH = 4
"""Pixels to each side that are searched for a surface's motion."""
OTHER_SURFACE = 2 * REACH * REACH + 1
"""Squared distance in pixels that is added for another surface; larger than any other."""


class ScatterTables(NamedTuple):
    """Two neighbouring frames, and the motion from the first to the second.

    Attributes:
        motion: (height, width, 2) output: motion of the first frame's samples to the second frame.
        mismatch: (height, width) output: relative difference of depth of the scattered sample.
        depth: (height, width) of the first frame.
        next_motion: (next_height, next_width, 2) of the second frame, back to the first.
        next_depth: (next_height, next_width).
        shift_x, shift_y: jitter of the second frame minus that of the first, in pixels of the first.
        scale_x, scale_y: size of the first frame / size of the second.
        width, height: size of the first frame.
        next_width, next_height: size of the second.
    """

    motion: Floats
    mismatch: Floats
    depth: Floats
    next_motion: Floats
    next_depth: Floats
    shift_x: float
    shift_y: float
    scale_x: float
    scale_y: float
    width: int
    height: int
    next_width: int
    next_height: int


@ieee_arithmetic
def reversed_frame(frame: Frame, following: Frame | None) -> Frame:
    """Return a frame for a run over reversed frames, in which `following` is the previous one.

    Args:
        frame: the frame.
        following: the next frame of the shot; None where the reversed run begins with `frame`.
    """
    if following is None:
        return replace(frame, motion=np.zeros((*frame.depth.shape, 2), np.float32), reset=True)
    given = frame.motion_next
    motion = scattered_motion(frame, following) if given is None else np.asarray(given, np.float32)
    return replace(frame, motion=motion, reset=False)


def scattered_motion(frame: Frame, following: Frame) -> Float32:
    """Return `frame.motion_next`, (h, w, 2) float32, computed from the motion of the next frame.

    The frames may have different render sizes.
    """
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
    kernel = kernel_if_possible("sequence.kernels.scatter_motion")
    if kernel is None:
        scatter_motion_numpy(tables)
    else:
        kernel(pack(tables))
    return tables.motion


def scatter_motion_numpy(tables: ScatterTables) -> None:
    """Write the motion as the kernel does, in numpy."""
    _scatter(tables)
    known = tables.mismatch < HIDDEN
    missing = ~known
    best = np.full(known.shape, np.inf, np.float32)  # squared distance, larger for other surfaces
    filled = tables.motion.copy()
    for dy, dx in sorted(_OFFSETS, key=lambda o: o[0] ** 2 + o[1] ** 2):
        is_known = _shifted(known, dy, dx, fill=False)
        depth = _shifted(tables.depth, dy, dx, fill=0.0)
        other = _mismatch(tables.depth, depth) > SAME_SURFACE
        cost = np.float32(dy * dy + dx * dx) + np.where(other, np.float32(OTHER_SURFACE), np.float32(0))
        take = missing & is_known & (cost < best)
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
    order = np.argsort(-mismatch, kind="stable")  # the last one written is kept
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
