"""Colours as three vectors, a channel each; twins of `supersampler_model.ops.color`."""

from typing import Any

import numpy as np

from supersampler.backends.cpu.simd.device_function import device_function
from supersampler.backends.cpu.simd.vector import (
    bits_of,
    float_of,
    floor,
    maximum,
    minimum,
    select,
    square_root,
    to_float,
    to_int,
)

MAX_HALF = 65504.0
DARKNESS = 1e-12
GLARING = 1024.0 / 1025.0
"""Of what is toned; see `supersampler_model.color`, as of the next two."""
GLARE, CONFIRMED = 4.0, 3.0


@device_function
def usable(r: Any, g: Any, b: Any) -> Any:
    """Where every channel is a number in [0, 65504]."""
    low = (r >= 0.0) & (g >= 0.0) & (b >= 0.0)
    return low & (r <= MAX_HALF) & (g <= MAX_HALF) & (b <= MAX_HALF)


@device_function
def without_glare(values: Any) -> Any:
    """Values in [0, 1], and frames that have had glare near, of what a history holds."""
    glared = floor(values * (1.0 / GLARE) + 0.5)
    return maximum(values - glared * GLARE, 0.0), glared


@device_function
def quarantined(c: Any) -> Any:
    """What is not a number in [0, 65504] becomes 0."""
    return select((c >= 0.0) & (c <= MAX_HALF), c, 0.0)


@device_function
def largest(r: Any, g: Any, b: Any) -> Any:
    return maximum(maximum(r, g), b)


@device_function
def toned(r: Any, g: Any, b: Any) -> Any:
    """Exposed linear RGB [0, inf) to [0, 1)."""
    scale = 1.0 / (largest(r, g, b) + 1.0)
    return r * scale, g * scale, b * scale


@device_function
def ycocg(r: Any, g: Any, b: Any) -> Any:
    both = (r + b) * 0.25
    return both + g * 0.5, (r - b) * 0.5, g * 0.5 - both


@device_function
def rgb(y: Any, co: Any, cg: Any) -> Any:
    return y + co - cg, y + cg, y - co - cg


@device_function
def luminance(r: Any, g: Any, b: Any) -> Any:
    return r * 0.2126 + g * 0.7152 + b * 0.0722


@device_function
def root(c: Any) -> Any:
    return square_root(maximum(c, 1e-6))


@device_function
def clamped(c: Any, low: float, high: float) -> Any:
    return minimum(maximum(c, low), high)


@device_function
def linear_of(r: Any, g: Any, b: Any, exposure: float) -> Any:
    """Toned colours back to linear RGB without exposure, bounded: `bounded(inverse_tone(...) / exposure)`."""
    back = 1.0 / (maximum(1.0 - largest(r, g, b), 1.0 / MAX_HALF) * exposure)
    r, g, b = minimum(r * back, MAX_HALF), minimum(g * back, MAX_HALF), minimum(b * back, MAX_HALF)
    dark = DARKNESS
    return select(r >= dark, r, 0.0), select(g >= dark, g, 0.0), select(b >= dark, b, 0.0)


@device_function
def exponential(x: Any) -> Any:
    """e^x of what is not above 0, to 3e-7 of it; 0 below e^-87."""
    y = maximum(x, -87.0) * 1.4426950408889634
    whole = floor(y + 0.5)
    f = y - whole
    p = ((f * 1.5403530e-4 + 1.3333558e-3) * f + 9.6181291e-3) * f + 5.5504109e-2
    p = ((p * f + 2.4022651e-1) * f + 6.9314718e-1) * f + 1.0
    return select(x < -87.0, 0.0, p * float_of((to_int(whole) + np.int32(127)) << np.int32(23)))


@device_function
def logarithm(x: Any) -> Any:
    """Natural logarithm of normal numbers above 0, to 2e-7 of it or of one."""
    bits = bits_of(x) - np.int32(0x3F3504F3)  # the mantissa from the square root of a half to that of two
    whole = to_float(bits >> np.int32(23))
    m = float_of((bits & np.int32(0x7FFFFF)) + np.int32(0x3F3504F3)) - 1.0
    p = ((m * 7.0376836292e-2 - 1.1514610310e-1) * m + 1.1676998740e-1) * m - 1.2420140846e-1
    p = (((p * m + 1.4249322787e-1) * m - 1.6668057665e-1) * m + 2.0000714765e-1) * m - 2.4999993993e-1
    p = (p * m + 3.3333331174e-1) * m * m * m
    return whole * 0.693359375 + (m + (p - m * m * 0.5 - whole * 2.12194440e-4))
