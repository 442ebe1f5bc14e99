"""Device functions for colours, a vector per channel; same as `supersampler_model.ops.color`."""

from typing import Any

import numpy as np

from supersampler.backends.cpu.simd.vector import (
    bits_of,
    device_function,
    float_of,
    floor,
    maximum,
    minimum,
    select,
    square_root,
    to_float,
    to_int,
)
from supersampler.io.display import BT709_WEIGHTS, MAX_HALF
from supersampler.methods.constants import DARKNESS, GLARE

RED, GREEN, BLUE = BT709_WEIGHTS


@device_function
def usable(r: Any, g: Any, b: Any) -> Any:
    """Return where no channel is NaN."""
    return is_number(r) & is_number(g) & is_number(b)


@device_function
def is_number(c: Any) -> Any:
    """Return where values are not NaN."""
    return (c >= 0.0) | (c < 0.0)


@device_function
def without_glare(values: Any) -> Any:
    """Split a history plane into values in [0, 1] and the number of glaring frames."""
    frames = floor(values * (1.0 / GLARE) + 0.5)
    return maximum(values - frames * GLARE, 0.0), frames


@device_function
def sanitize(c: Any) -> Any:
    """Clamp to [0, MAX_HALF]; NaN becomes 0."""
    return minimum(select(c > 0.0, c, 0.0), MAX_HALF)


@device_function
def largest(r: Any, g: Any, b: Any) -> Any:
    """Return the largest channel."""
    return maximum(maximum(r, g), b)


@device_function
def toned(r: Any, g: Any, b: Any) -> Any:
    """Convert exposed linear RGB, [0, inf), to [0, 1)."""
    scale = 1.0 / (largest(r, g, b) + 1.0)
    return r * scale, g * scale, b * scale


@device_function
def ycocg(r: Any, g: Any, b: Any) -> Any:
    """Convert RGB to YCoCg."""
    half = (r + b) * 0.25
    return half + g * 0.5, (r - b) * 0.5, g * 0.5 - half


@device_function
def from_ycocg(y: Any, co: Any, cg: Any) -> Any:
    """Convert YCoCg to RGB."""
    return y + co - cg, y + cg, y - co - cg


@device_function
def luminance(r: Any, g: Any, b: Any) -> Any:
    """Return the luminance of linear RGB (Rec. 709)."""
    return r * RED + g * GREEN + b * BLUE


@device_function
def root(c: Any) -> Any:
    """Return the square root, with a bounded slope at 0."""
    return square_root(maximum(c, 1e-6))


@device_function
def clamped(c: Any, low: float, high: float) -> Any:
    """Clamp to [low, high]."""
    return minimum(maximum(c, low), high)


@device_function
def scaled3(color: Any, scale: Any) -> Any:
    """Multiply three channels by a scale."""
    return color[0] * scale, color[1] * scale, color[2] * scale


@device_function
def select3(mask: Any, first: Any, second: Any) -> Any:
    """Return three channels of `first` where the mask is set, else of `second`."""
    a, b = first, second
    return select(mask, a[0], b[0]), select(mask, a[1], b[1]), select(mask, a[2], b[2])


@device_function
def lerp(a: Any, b: Any, weight: Any) -> Any:
    """Return `a` where the weight is 0, `b` where it is 1."""
    return a + weight * (b - a)


@device_function
def lerp3(a: Any, b: Any, weight: Any) -> Any:
    """Interpolate three channels; see `lerp`."""
    return lerp(a[0], b[0], weight), lerp(a[1], b[1], weight), lerp(a[2], b[2], weight)


@device_function
def linear_of(r: Any, g: Any, b: Any, exposure: float) -> Any:
    """Convert toned colours to linear RGB: `bounded(inverse_tone(...) / exposure)`."""
    scale = 1.0 / (maximum(1.0 - largest(r, g, b), 1.0 / MAX_HALF) * exposure)
    r, g, b = minimum(r * scale, MAX_HALF), minimum(g * scale, MAX_HALF), minimum(b * scale, MAX_HALF)
    return select(r >= DARKNESS, r, 0.0), select(g >= DARKNESS, g, 0.0), select(b >= DARKNESS, b, 0.0)


@device_function
def exponential(x: Any) -> Any:
    """Return e^x for x <= 0, with a relative error of 3e-7; 0 for x < -87."""
    y = maximum(x, -87.0) * 1.4426950408889634
    exponent = floor(y + 0.5)
    f = y - exponent
    p = ((f * 1.5403530e-4 + 1.3333558e-3) * f + 9.6181291e-3) * f + 5.5504109e-2
    p = ((p * f + 2.4022651e-1) * f + 6.9314718e-1) * f + 1.0
    return select(x < -87.0, 0.0, p * float_of((to_int(exponent) + np.int32(127)) << np.int32(23)))


@device_function
def logarithm(x: Any) -> Any:
    """Return the natural logarithm of normal numbers above 0, with an error of 2e-7, relative or absolute."""
    bits = bits_of(x) - np.int32(0x3F3504F3)  # mantissa in [sqrt(1/2), sqrt(2))
    exponent = to_float(bits >> np.int32(23))
    m = float_of((bits & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3)) - 1.0
    p = ((m * 7.0376836292e-2 - 1.1514610310e-1) * m + 1.1676998740e-1) * m - 1.2420140846e-1
    p = (((p * m + 1.4249322787e-1) * m - 1.6668057665e-1) * m + 2.0000714765e-1) * m - 2.4999993993e-1
    p = (p * m + 3.3333331174e-1) * m * m * m
    return exponent * 0.693359375 + (m + (p - m * m * 0.5 - exponent * 2.12194440e-4))
