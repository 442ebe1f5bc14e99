"""Pass 5, first part: this frame's colour at display pixels, and the box of its 3x3 samples; YCoCg."""

from typing import NamedTuple

import numpy as np

from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import EPSILON, View, lerp, saturate
from supersampler_bench.fsr2.locks import UPSAMPLE_WEIGHT_SCALE, Bool
from supersampler_bench.fsr2.sampling import Indices, centres, lanczos2_of_square


class Box(NamedTuple):
    """Mean, standard deviation, minimum and maximum, (H, W, 3) each, of the samples around a pixel."""

    centre: Array
    deviation: Array
    least: Array
    most: Array


class Upsampled(NamedTuple):
    """Colour (H, W, 3) of this frame, the weight (H, W) of its samples, and their box."""

    color: Array
    weight: Array
    box: Box


def upsample(color: Array, reactive: Array, disoccluded: Array, speed: Array, view: View) -> Upsampled:
    """Sample a frame by Lanczos2 over 3x3 samples.

    Args:
        color: (h, w, 3) prepared YCoCg.
        reactive: (H, W), 1 where there is no history: the wider the kernel.
        disoccluded: (H, W).
        speed: (H, W) display pixels: the faster, the narrower the box.
        view: of the frame.
    """
    bias = _kernel_bias(reactive, disoccluded, view)
    curve = lerp(-2.0, -3.0, saturate(speed / np.float32(50.0)))
    columns = _axis(view.render[0], view.display[0], view.jitter[0])
    rows = _axis(view.render[1], view.display[1], view.jitter[1])
    total = np.zeros((*speed.shape, 4), np.float32)
    moments = np.zeros((*speed.shape, 7), np.float32)
    samples = []
    for row, y, row_inside in rows:
        for column, x, column_inside in columns:
            sample = color[row][:, column]
            squared = y[:, None] ** 2 + x[None] ** 2
            inside = row_inside[:, None] & column_inside[None]
            weight = (lanczos2_of_square(squared * bias * bias) * inside)[..., None]
            total += weight * np.concatenate([sample, np.ones_like(weight)], axis=-1)
            box_weight = np.exp(curve * squared)[..., None]
            ones = np.ones_like(box_weight)
            moments += box_weight * np.concatenate([sample, sample * sample, ones], axis=-1)
            samples.append(sample)
    return _normalized(total, _box(moments, samples))


def _axis(render: int, display: int, jitter: float) -> list[tuple[Indices, Array, Bool]]:
    """Return index, offset in render pixels, and whether on screen, of three samples around each pixel."""
    centre = centres((display, 1))[0][0] * np.float32(render / display)
    nearest = np.floor(centre).astype(np.int64)
    return [
        (
            np.clip(nearest + k, 0, render - 1),
            (nearest + k + np.float32(0.5 + jitter) - centre).astype(np.float32),
            (nearest + k >= 0) & (nearest + k < render),
        )
        for k in (-1, 0, 1)
    ]


def _kernel_bias(reactive: Array, disoccluded: Array, view: View) -> Array:
    """Factor on distances in the kernel: above 1 it is narrower than a render pixel's."""
    most = np.float32(min(1.99, float(view.upscale[0]))) * (1.0 - reactive)
    least = np.maximum(1.0, (1.0 + most) * 0.3)
    return lerp(most, least, np.maximum(0.25 * disoccluded, reactive))


def _box(moments: Array, samples: list[Array]) -> Box:
    weight = moments[..., 6:]
    weight = np.where(np.abs(weight) > EPSILON, weight, np.float32(1.0))
    centre, square = moments[..., :3] / weight, moments[..., 3:6] / weight
    deviation = np.sqrt(np.abs(square - centre * centre))
    return Box(centre, deviation, np.minimum.reduce(samples), np.maximum.reduce(samples))


def _normalized(total: Array, box: Box) -> Upsampled:
    """Divide by the weight and clamp to the box; where the weight is nothing, the colour does not count."""
    weight = total[..., 3:]
    counts = weight > EPSILON
    color = np.clip(total[..., :3] / np.where(counts, weight, np.float32(1.0)), box.least, box.most)
    scaled = np.where(counts, weight * np.float32(UPSAMPLE_WEIGHT_SCALE), np.float32(0.0))
    return Upsampled(color, scaled[..., 0], box)
