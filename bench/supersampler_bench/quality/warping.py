"""Baseline for unshaded frames without a model: the last image, warped by motion."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32, Frame
from supersampler_bench.quality import masks, metrics

Bool = NDArray[np.bool_]
REACH = 32
"""Radius, display pixels, of the search for a disoccluded pixel's background."""


def warped(image: Float32, frame: Frame) -> Float32:
    """Reproject the previous image, (H, W, 3), by a frame's motion; off screen the border repeats."""
    height, width = image.shape[:2]
    motion = masks.display_motion(frame, (width, height))
    rows, columns = np.indices((height, width))
    x, y = (np.clip(columns + motion[..., 0], 0, width - 1), np.clip(rows + motion[..., 1], 0, height - 1))
    found, _ = metrics.warp(image, np.stack([x - columns, y - rows], axis=-1))
    return found.astype(np.float32)


def with_background_filled(image: Float32, frame: Frame, before: Frame) -> Float32:
    """Fill disoccluded and off-screen pixels of a warped image from the nearest background.

    That is the nearest pixel, within REACH, that was fully visible and is not closer than the filled one.

    Args:
        image: (H, W, 3), by `warped`.
        frame: this one.
        before: the previous one, shaded or unshaded.
    """
    size = (image.shape[1], image.shape[0])
    unshaded, in_part, depth = (
        masks.to_display(plane, frame.jitter, size)
        for plane in (
            masks.disoccluded(frame, before),
            masks.disoccluded(frame, before, in_part=True),
            frame.depth,
        )
    )
    filled, (rows, columns) = image.copy(), np.nonzero(unshaded)
    for down, across in _outwards():
        y, x = rows + down, columns + across
        inside = (y >= 0) & (y < size[1]) & (x >= 0) & (x < size[0])
        y, x = np.clip(y, 0, size[1] - 1), np.clip(x, 0, size[0] - 1)
        behind = depth[y, x] <= masks.DEPTH_RATIO * depth[rows, columns]
        found = inside & ~in_part[y, x] & behind
        filled[rows[found], columns[found]] = image[y[found], x[found]]
        rows, columns = rows[~found], columns[~found]
        if not len(rows):
            break
    return filled


def motion_over_two_frames(frame: Frame, since: Array | None, jitter: tuple[float, float]) -> Array:
    """Return motion (h, w, 2) from a frame across the previous one, to the frame that `since` leads to.

    Args:
        frame: this one.
        since: (h, w, 2), from the previous frame to an earlier one; None: return the frame's own motion.
        jitter: of the previous frame.
    """
    if since is None:
        return frame.motion
    to_sample = frame.motion + np.subtract(frame.jitter, jitter)
    further, inside = metrics.warp(since, to_sample)
    total = np.where(inside[..., None], frame.motion + further, frame.motion)  # off screen: no matter
    return total.astype(np.float32)


def _outwards() -> Iterator[tuple[int, int]]:
    """Yield offsets (down, across) within REACH of a pixel, the nearest first."""
    rows, columns = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]
    far = np.hypot(rows, columns)
    order = np.argsort(far, axis=None, kind="stable")[1:]
    kept = order[far.ravel()[order] <= REACH]
    yield from zip(rows.ravel()[kept].tolist(), columns.ravel()[kept].tolist(), strict=True)
