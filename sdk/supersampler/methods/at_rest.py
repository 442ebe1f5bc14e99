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
the block changed, negative once it is frozen, and the sums of three tests. `signatures`: one of each
block for each phase of the jitter. `phases`: jitter x and y, frames since it was last seen, frames between
its last two."""
ADDS_SAMPLES, NOISY = "adds_samples", 2.0
"""Input of the step: 0 on frames whose colour was not sampled, NOISY on those of a path tracer, else 1."""
ADDED: Mapping[AtRest, float] = {"off": 0.0, "converge": 1.0, "accumulate": NOISY}
"""`adds_samples` of shaded frames in each mode."""
BRIGHTEST = 65536.0
"""Limit of a mean of samples, each at most 65504, in single precision."""
CONVERGED: Mapping[str, MapOf] = {"converged": MapOf("converged", 0, 1)}
"""1 where the image is frozen, else 0: an auxiliary output of shape (1, 1, *DISPLAY)."""
BLOCK = 4
"""Side of a block, samples. Blocks are compared with the previous frame of the same jitter."""
TILE = 32
"""Side of a tile, display pixels, whose own history a method keeps while all its blocks are frozen."""
MAX_STATIC_MOTION = 1.0 / 256.0
"""Longest motion of a static sample, render pixels."""
PHASES_PER_SAMPLE, SPARE_PHASES = 9, 2
"""Phases of which signatures are kept: int(9 ratio^2) + 2. A jitter sequence has int(8 ratio^2), of a ratio
that sizes are rounded from."""
OLDEST = float(1 << 20)
"""Limit of counted frames, up to which float32 counts exactly."""
ORDER = 0.7548776662466927
"""Step of the weights in the last value of a signature: the inverse of the plastic number."""
TOLERANCE = 1.0 / 1024.0
"""Largest difference of two equal signatures, as a part of their mean: 0.4 % of the light of a block."""
DARK = 1e-3
"""Exposed light below which differences do not show: less than 1/255 of the display is."""
INNER, OUTER = 0.35, 0.65
"""Distances from a pixel's centre along an axis, display pixels, up to which a sample has the weight 1, and
from which it has none. They were chosen by error: 0.4 and 0.6 lose 0.4 dB in rendered scenes, 0.25 and 0.75
lose 1.8 dB where patterns are fine."""
SHOWN_FROM, SHOWN = 1.5, 1.75
"""Jitter periods after which the mean begins to show, and after which only the mean shows. A block freezes
after two periods."""
LEAST_WEIGHT = 3.5
"""Minimum weight of a mean that is shown. A whole period has about 8, one for each sample in a pixel."""
FLICKER = 0.02
"""Root mean square residual of a window, relative to its mean, up to which it counts as zero."""
SMALL_WINDOW, LARGE_WINDOW = WINDOWS = (2, 8)
"""Sides of the two windows in which residuals are averaged, blocks."""
UNIFORM, PARTIAL, COMMON = 0.8, 0.1, 0.06
"""Mean square residual of the small and of the large window, over the variance of the residuals in it, above
which light changes with the jitter. Of static scenes nearly all windows are below 0.6 and 0.02; light that
changes by one factor has the reciprocal of the squared contrast of the ground, and f / (1 - f) where it
changes in a part f of a window. A light that fills a window reaches into those around it: beside a window
above UNIFORM, the limit is PARTIAL."""
UNRESOLVED = 0.85
"""Variance of the residuals in a small window, over that of the samples, above which the
pattern is taken to move in step with the jitter, so that its samples have no common mean. Static patterns
reach 0.8."""
SPARKLING = 2.0
"""Variance of the samples, over the square of their mean, above which single bright samples stand out. There
the limit rises towards 1."""
BESIDE = 0.05
"""Fraction of the largest sample variance of adjacent windows that is added to a window's own: mean pixels at
its border hold samples from beyond it."""
NOISE_RATE = 0.125
"""Weight of a frame in the running mean of the residuals of noisy samples."""
NOISE_FLICKER, NOISE_SIGMAS = 0.05, 5.0
"""Limits of that mean: a fraction of the light, and a number of standard deviations of the noise."""
NOISE_WEIGHT = 2.0
"""Weight from which on a mean of noisy samples shows; from twice that it is shown alone."""


def block_count(render: Size) -> Size:
    """Return the number of blocks of a frame, (across, down)."""
    return -(-render[0] // BLOCK), -(-render[1] // BLOCK)


def phase_count(display: Size, render: Size) -> int:
    """Return the number of jitter phases whose signatures are kept."""
    return PHASES_PER_SAMPLE * display[0] * display[1] // (render[0] * render[1]) + SPARE_PHASES


def block_of_pixels(display: int, render: int) -> NDArray[np.intp]:
    """Return the index of the block of each display pixel along an axis, from its numbers of pixels."""
    blocks = (2 * np.arange(display) + 1) * render // (2 * BLOCK * display)
    return np.minimum(blocks, -(-render // BLOCK) - 1)


def converged_fraction(static_blocks: Float32, display: Size, render: Size) -> float:
    """Return the share of an image's pixels whose block is frozen, [0, 1].

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
