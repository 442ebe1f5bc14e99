"""Kernel of `camera_motion`: compiled, never called from Python."""

import numpy as np

from supersampler.backends.cpu.simd.shuffles import high_zip, low_zip
from supersampler.backends.cpu.simd.vector import load16, select, store
from supersampler.conventions.camera_motion import BEHIND, MotionTables


def write_motion(tables: MotionTables):
    """Write the motion, of what was behind the previous camera two image sizes; width: at least 16."""
    motion, depth, columns, rows = tables.motion, tables.depth, tables.columns, tables.rows
    width, height = tables.width, tables.height
    for row in range(height):
        y, y_depth, y_x, y_rest, y_w = (rows[5 * row], rows[5 * row + 1], rows[5 * row + 2],
                                        rows[5 * row + 3], rows[5 * row + 4])  # fmt: skip
        for start in range(0, width, 16):
            x = min(start, width - 16)  # the last sixteen pixels overlap
            pixel = row * width + x
            d = load16(depth, pixel) - tables.far_depth
            w = d * tables.depth_w + load16(columns, 4 * width + x) + y_w
            behind = w < BEHIND
            w = select(behind, 1.0, w)
            x_motion = load16(columns, x) * d + load16(columns, width + x) * y
            x_motion = x_motion + load16(columns, 2 * width + x)
            y_motion = d * y_depth + load16(columns, 3 * width + x) * y_x + y_rest
            x_motion = select(behind, np.float32(-2 * width), x_motion / w)
            y_motion = select(behind, np.float32(-2 * height), y_motion / w)
            store(motion, 2 * pixel, low_zip(x_motion, y_motion))
            store(motion, 2 * pixel + 16, high_zip(x_motion, y_motion))
