"""Exposure from what a frame shows; twin of `supersampler_model.color.exposure_for`."""

import math

from supersampler.frame import Float32

KEY, ADAPTATION = 0.18, 0.1


def exposure_of(rows: Float32, before: float) -> float:
    """0.18 over the log-average luminance, adapting from `before` where that is > 0.

    Args:
        rows: (h, 2) of each row's usable samples, the sum of logarithms of luminance, and how many.
        before: exposure of the frame before; 0 where there is none.
    """
    logs, count = (float(total) for total in rows.sum(axis=0, dtype=float))
    target = KEY * math.exp(-logs / max(count, 1.0))
    if before <= 0.0:
        return target
    return before ** (1.0 - ADAPTATION) * target**ADAPTATION if count else before
