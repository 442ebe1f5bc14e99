"""Masks of difficult pixels, from a shot's truth classes, or from the depth and motion of its frames."""

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size
from supersampler.io.shot import ClassMaps
from supersampler_bench.quality.metrics import Bool

MOVING_PIXELS = 0.5
"""Motion, render pixels per frame, above which a pixel counts as moving; jitter alone spans that much."""

DEPTH_RATIO = 1.1
"""Ratio of distances above which the previous surface occluded the current one."""


def moving(frame: Frame) -> Bool:
    """Return (h, w), True where the motion of camera or objects exceeds `MOVING_PIXELS`."""
    motion = frame.motion.astype(np.float32)
    return np.asarray(np.hypot(motion[..., 0], motion[..., 1]) > MOVING_PIXELS)


def disoccluded(frame: Frame, previous: Frame | None, *, in_part: bool = False) -> Bool:
    """Return (h, w), True where the visible surface was occluded or off screen in the previous frame.

    A surface counts as occluded where all four samples around its previous position were closer by more than
    `DEPTH_RATIO`, or with `in_part`, one of them. All pixels are True on the first frame and after a cut.
    """
    if previous is None or frame.reset:
        return np.ones(frame.depth.shape, bool)
    (width, height), (w, h) = frame.size, previous.size
    rows, columns = np.indices((height, width))
    motion = frame.motion.astype(np.float64)
    # previous position on screen, whose corner is (0, 0); a sample lies at centre + jitter
    x = columns + 0.5 + frame.jitter[0] + motion[..., 0]
    y = rows + 0.5 + frame.jitter[1] + motion[..., 1]
    inside = (x >= 0) & (x <= width) & (y >= 0) & (y <= height)
    x, y = x * (w / width) - 0.5 - previous.jitter[0], y * (h / height) - 0.5 - previous.jitter[1]
    left, top = (np.floor(np.where(inside, v, 0)).astype(np.intp) for v in (x, y))
    taps = [
        previous.depth[np.clip(top + dy, 0, h - 1), np.clip(left + dx, 0, w - 1)]
        for dy in (0, 1)
        for dx in (0, 1)
    ]
    before = np.maximum.reduce(taps) if in_part else np.minimum.reduce(taps)  # reversed: small is far
    return np.asarray(~inside | (before > DEPTH_RATIO * frame.depth))


def of_classes(classes: ClassMaps) -> dict[str, Bool]:
    """Return masks (H, W): `disoccluded`, `changing_light`, `aliased`, and `thin` if it is known."""
    ghost, alias, thin = classes.ghost, classes.alias, classes.thin
    known = {"disoccluded": ghost == 1, "changing_light": ghost == 2, "aliased": alias != 0}
    return known if thin is None else {**known, "thin": thin == 1}


def to_display(plane: NDArray[Any], jitter: tuple[float, float], display_size: Size) -> NDArray[Any]:
    """Resample (h, w, ...) at render size to display size (H, W, ...) by the nearest sample.

    Display pixel p reads (p + 0.5) / r - 0.5 - jitter in the input, per axis. Values are not scaled.
    """
    height, width = plane.shape[:2]
    columns = _nearest(display_size[0], width, jitter[0])
    rows = _nearest(display_size[1], height, jitter[1])
    return plane[rows[:, None], columns]


def display_motion(frame: Frame, display_size: Size) -> Float32:
    """Return the motion (H, W, 2) of the nearest sample, in display pixels."""
    ratio = np.array(display_size, np.float32) / np.array(frame.size, np.float32)
    nearest = to_display(frame.motion, frame.jitter, display_size)
    return np.asarray(nearest.astype(np.float32) * ratio, np.float32)


def _nearest(display: int, render: int, jitter: float) -> NDArray[np.intp]:
    position = (np.arange(display) + 0.5) * render / display - 0.5 - jitter
    return np.clip(np.floor(position + 0.5), 0, render - 1).astype(np.intp)


def dilated(mask: Bool, reach: int, *, edge: bool = False) -> Bool:
    """Return the pixels with a True one in the square of `reach` pixels around; `edge`: beyond the image."""
    padded = np.pad(mask, reach, constant_values=edge)
    for axis in (0, 1):
        padded = np.asarray(sliding_window_view(padded, 2 * reach + 1, axis).any(axis=-1))
    return padded
