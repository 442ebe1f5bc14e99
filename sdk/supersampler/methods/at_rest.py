"""History tensors and constants of the convergence of static pixels (torch: `ops.at_rest`)."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import AtRest
from supersampler.frame import Float32, Size
from supersampler.methods.spec import BLOCKS, DISPLAY, PHASES, MapOf, Shape

AT_REST_HISTORY: Mapping[str, Shape] = {
    "static_mean": (1, 4, *DISPLAY),
    "static_blocks": (1, 4, *BLOCKS),
    "signatures": (PHASES, 4, *BLOCKS),
    "phases": (PHASES, 4),
}
"""`static_mean`: mean of the samples, linear RGB, and the sum of their weights. `static_blocks`: frames since
the block changed, negative once it is frozen, and the sums of three tests. `signatures`: signature of each
block in each phase of the jitter. `phases`: for each phase, jitter x and y, frames since it last occurred,
and frames between its last two occurrences."""
ADDS_SAMPLES, NOISY = "adds_samples", 2.0
"""Input of the step: 0 for a frame whose colour was not sampled, NOISY for a path tracer's, else 1."""
ADDED: Mapping[AtRest, float] = {"off": 0.0, "converge": 1.0, "accumulate": NOISY}
"""`adds_samples` of shaded frames in each mode."""
BRIGHTEST = 65536.0
"""Upper limit of a mean of samples of at most 65504, rounded in single precision."""
CONVERGED: Mapping[str, MapOf] = {"converged": MapOf("converged", 0, 1)}
"""1 where the image is frozen, else 0: an auxiliary output of shape (1, 1, *DISPLAY)."""
BLOCK = 4
"""Side of a block, samples. A block is compared with itself in the previous frame of the same jitter."""
TILE = 32
"""Side of a tile, display pixels. A method keeps its history of a tile while all blocks in it are frozen."""
MAX_STATIC_MOTION = 1.0 / 256.0
"""Longest motion of a static sample, render pixels."""
PHASES_PER_SAMPLE, SPARE_PHASES = 9, 2
"""Number of phases whose signatures are kept: int(9 ratio^2) + 2. A jitter sequence has int(8 ratio^2), but
its ratio may differ, because sizes are rounded."""
OLDEST = float(1 << 20)
"""Limit of frame counts; float32 counts exactly up to it."""
ORDER_FACTOR, ORDER_PRIME = 151, 383
"""Value k of a block has in the last value of a signature the weight ORDER_FACTOR k^3 modulo ORDER_PRIME,
scaled to [-1, 1]. Weights linear in k (modulo 1) would cancel in a chequered pattern of 1 or 2 samples a
cell. These numbers locate patterns of period 2 or 4 best."""
TOLERANCE = 1.0 / 1024.0
"""Largest relative difference of two signatures that count as equal: 0.4 % of the light of a block."""
DARK = 1e-3
"""Exposed light that is added to a level before differences are divided by it: smaller differences are below
1/255 of the display."""
INNER, OUTER = 0.35, 0.65
"""Distances from a pixel's centre along an axis, display pixels, up to which a sample has the weight 1, and
from which it has none. They minimize the error: 0.4 and 0.6 lose 0.4 dB in rendered scenes, 0.25 and 0.75
lose 1.8 dB in fine patterns."""
SHOWN_FROM, SHOWN = 1.5, 1.75
"""Jitter periods after which the mean begins to fade in, and after which it has replaced the method's image.
A block freezes after two periods."""
LEAST_WEIGHT = 3.5
"""Minimum weight of a mean that is shown. A whole period has about 8: one for each sample in a pixel."""
FLICKER = 0.02
"""Root mean square residual of a window, relative to its mean, up to which it counts as zero."""
SMALL_WINDOW, LARGE_WINDOW = WINDOWS = (2, 8)
"""Sides of the two windows in which residuals are averaged, blocks."""
UNIFORM, PARTIAL, COMMON = 0.8, 0.1, 0.06
"""Limits of the mean square residual of a window, relative to the variance of its residuals, above which its
light changes with the jitter: UNIFORM in a small window; PARTIAL in a small window next to one above UNIFORM,
whose light reaches into it; COMMON in a large window. In static scenes nearly all windows stay below 0.6
(small) and 0.02 (large). Light that changes by one factor yields the reciprocal of the surface's squared
contrast; light that changes in a fraction f of a window yields f / (1 - f)."""
UNRESOLVED = 0.85
"""Variance of the residuals in a small window, relative to the variance of the samples, above which a pattern
counts as moving in step with the jitter: its samples have no common mean. Static patterns reach 0.8."""
SPARKLING = 2.0
"""Variance of the samples, relative to their squared mean, above which single bright samples stand out. Then
the limit UNRESOLVED rises towards 1."""
BESIDE = 0.05
"""Fraction of the largest sample variance of adjacent windows that is added to a window's own, because pixels
of the mean at its border contain samples of those windows."""
NOISE_RATE = 0.125
"""Weight of a frame in the running mean of the residuals of noisy samples."""
NOISE_FLICKER, NOISE_SIGMAS = 0.05, 5.0
"""Limit of that mean: the sum of a fraction of the light and a number of standard deviations of the noise."""
NOISE_WEIGHT = 2.0
"""Weight from which on a mean of noisy samples fades in; from twice that on it is shown alone."""


def block_count(render: Size) -> Size:
    """Return the number of blocks of a frame, (across, down)."""
    return -(-render[0] // BLOCK), -(-render[1] // BLOCK)


def phase_count(display: Size, render: Size) -> int:
    """Return the number of jitter phases whose signatures are kept."""
    return PHASES_PER_SAMPLE * display[0] * display[1] // (render[0] * render[1]) + SPARE_PHASES


def block_of_pixels(display: int, render: int) -> NDArray[np.intp]:
    """Return the index of the block of each display pixel along an axis of these numbers of pixels."""
    blocks = (2 * np.arange(display) + 1) * render // (2 * BLOCK * display)
    return np.minimum(blocks, -(-render // BLOCK) - 1)


def converged_fraction(static_blocks: Float32, display: Size, render: Size) -> float:
    """Return the fraction of an image's pixels whose block is frozen, [0, 1].

    Args:
        static_blocks: (1, 4, down, across) the history tensor.
        display: (width, height) of the image.
        render: (width, height) of the last frame.
    """
    frozen = static_blocks[0, 0] < 0.0
    columns, rows = (
        np.bincount(block_of_pixels(*sizes), minlength=count)
        for *sizes, count in zip(display, render, block_count(render), strict=True)
    )
    return float(rows @ frozen @ columns) / (display[0] * display[1])


def check_history(arrays: Mapping[str, NDArray[Any]], refusal: Callable[[str, str], Exception]) -> None:
    """Raise unless the history tensors hold values that a step can write.

    Args:
        arrays: arrays by name in the graph, of the right types and shapes; others are ignored.
        refusal: makes the exception that is raised.
    """
    mean, phases = arrays["history.static_mean"], arrays["history.phases"]
    ranges = (
        ("colours", mean[:, :3], 0.0, BRIGHTEST, False),
        ("weights", mean[:, 3:], 0.0, np.inf, False),
        ("ages of blocks", arrays["history.static_blocks"][:, 0], -OLDEST, OLDEST, True),
        ("jitter of phases", phases[:, :2], -0.5, 0.5, False),
        ("ages of phases", phases[:, 2:], 0.0, OLDEST, True),
    )
    for name, values, minimum, maximum, whole in ranges:
        low, high = float(values.min()), float(values.max())
        if not (minimum <= low and high <= maximum):
            raise refusal(f"with {name} from {low:g} to {high:g}", f"from {minimum:g} to {maximum:g}")
        if whole and (values % 1.0).any():
            raise refusal(f"with {name} such as {float(values[values % 1.0 != 0.0][0])!r}", "whole numbers")
