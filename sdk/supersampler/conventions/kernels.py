"""Kernel of `camera_motion`, and the same in numpy for where kernels cannot be compiled."""

from typing import NamedTuple

import numpy as np

from supersampler.backends.cpu.structs import Floats

_BEHIND = np.float32(1e-6)  # w of the previous clip space over that of this one


class MotionTables(NamedTuple):
    """A depth buffer, and the coefficients of its motion.

    At (x, y) with depth d, counted from the farthest depth, the motion is N / W with
        N = columns[0] d + columns[1] rows[0] + columns[2] in x,
        N = rows[1] d + rows[2] columns[3] + rows[3] in y,
        W = depth_w d + columns[4] + rows[4].

    Attributes:
        motion: (height, width, 2) render pixels, written to.
        depth: (height, width).
        columns: (5, width) factor of depth, factor of y, rest, x in clip space, part of W.
        rows: (height, 5) y in clip space, factor of depth, factor of x, rest, part of W.
        depth_w: factor of depth in W.
        far_depth: the farthest depth.
        width, height: of the image.
    """

    motion: Floats
    depth: Floats
    columns: Floats
    rows: Floats
    depth_w: float
    far_depth: float
    width: int
    height: int


def write_motion(tables: MotionTables):
    """Write the motion of each pixel; what was behind the previous camera gets two image sizes."""
    motion, depth, columns, rows = tables.motion, tables.depth, tables.columns, tables.rows
    width, height = tables.width, tables.height
    for row in range(height):
        y, y_depth, y_x, y_rest, y_w = (rows[5 * row], rows[5 * row + 1], rows[5 * row + 2],
                                        rows[5 * row + 3], rows[5 * row + 4])  # fmt: skip
        for column in range(width):
            pixel = row * width + column
            d = depth[pixel] - tables.far_depth
            w = tables.depth_w * d + columns[4 * width + column] + y_w
            x_rest = columns[2 * width + column]
            if w < _BEHIND:
                motion[2 * pixel], motion[2 * pixel + 1] = np.float32(-2 * width), np.float32(-2 * height)
            else:
                motion[2 * pixel] = (columns[column] * d + columns[width + column] * y + x_rest) / w
                motion[2 * pixel + 1] = (y_depth * d + y_x * columns[3 * width + column] + y_rest) / w


def write_motion_numpy(tables: MotionTables) -> None:
    """Write the same, bit for bit, without a compiler."""
    x_depth, x_y, x_rest, x, x_w = tables.columns
    y, y_depth, y_x, y_rest, y_w = tables.rows.T[..., None]
    d = tables.depth - np.float32(tables.far_depth)
    w = np.float32(tables.depth_w) * d + x_w + y_w
    behind = w < _BEHIND
    w[behind] = 1.0
    np.divide(x_depth * d + x_y * y + x_rest, w, out=tables.motion[..., 0])
    np.divide(y_depth * d + y_x * x + y_rest, w, out=tables.motion[..., 1])
    tables.motion[behind] = -2 * tables.width, -2 * tables.height
