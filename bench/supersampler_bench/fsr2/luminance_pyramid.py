"""Pass 1, compute luminance pyramid: log luminance in cells of 32x32 pixels, and the exposure.

exposure = 1 / Lmax,  Lmax = 78 / (0.65 S) 2^log2(Lavg S / K),  S = 100,  K = 12.5
"""

import math

import numpy as np

from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import EPSILON, View
from supersampler_bench.fsr2.color import luma
from supersampler_bench.fsr2.sampling import bilinear, centres

_CELL = 32  # pixels a side of mip 4 of half the render size, FFX_FSR2_SHADING_CHANGE_MIP_LEVEL


def log_luma(color: Array, view: View) -> Array:
    """Return ln of the luminance (h, w), read where pixel centres are without jitter."""
    x, y = centres(view.render)
    return np.log(np.maximum(luma(bilinear(color, x - view.jitter[0], y - view.jitter[1])), EPSILON))


def shading_grid(logs: Array) -> Array:
    """Return the mean of each whole cell, (max(h // 32, 1), max(w // 32, 1)); off screen counts as 0."""
    rows, columns = (max(side // _CELL, 1) for side in logs.shape)
    whole = np.zeros((rows * _CELL, columns * _CELL), np.float32)
    inside = logs[: rows * _CELL, : columns * _CELL]
    whole[: inside.shape[0], : inside.shape[1]] = inside
    return np.asarray(whole.reshape(rows, _CELL, columns, _CELL).mean(axis=(1, 3)))


def followed_average(logs: Array, before: float | None, seconds: float) -> float:
    """Return the mean log luminance as the exposure follows it; `before` is that of the previous frame."""
    mean = float(logs.mean(dtype=np.float64))
    return mean if before is None else before + (mean - before) * (1.0 - math.exp(-seconds))


def auto_exposure(average_log: float) -> float:
    """Return the exposure for a mean log luminance, the response of film of ISO 100."""
    speed, calibration, vignetting = 100.0, 12.5, 0.65
    return vignetting * speed / 78.0 / (math.exp(average_log) * speed / calibration)


def shading_luma(grid: Array, exposure: float, view: View) -> Array:
    """Return what shading change is seen by, (H, W): the sixth root of exposed luminance of the grid.

    The grid, stretched to the display as FSR2 does it, lacks what is right of and below its last whole cell.
    """
    x, y = centres(view.display)
    rows, columns = grid.shape
    across, down = x / view.display[0] * columns, y / view.display[1] * rows
    logs = bilinear(grid[..., None], across, down)[..., 0]
    return np.power(np.float32(exposure) * np.exp(logs), np.float32(1.0 / 6.0))
