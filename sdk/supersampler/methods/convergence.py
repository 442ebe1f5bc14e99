"""History tensors and constants of the convergence of static pixels (ops/convergence.py of the model).

Weights are sums of those of samples in the mean: one period of `jitter_phase_count` frames adds about 3.75 at
any ratio, eight samples per display pixel.
"""

from collections.abc import Mapping

import numpy as np

from supersampler.frame import Float32
from supersampler.methods.spec import DISPLAY, PREVIOUS, MapOf, Shape

CONVERGENCE_HISTORY: Mapping[str, Shape] = {
    "static_mean": (1, 4, *DISPLAY),
    "residual_range": (1, 3, *PREVIOUS),
}
"""`static_mean`: mean of the samples, linear RGB, and the sum of their weights, negative after a frame that
opened or doubted the pixel. `residual_range`: least and largest residual, and the samples per display pixel
from which they were learned."""
ADDS_SAMPLES = "adds_samples"
"""Input of the step: 0 on frames that add nothing to the mean, else 1."""
CONVERGED: Mapping[str, MapOf] = {"converged": MapOf("converged", 0, 1)}
"""The fraction of the mean in the image, an auxiliary output of shape (1, 1, *DISPLAY)."""
SIGMA = 0.4
"""Gaussian of a sample's weight in the mean, display pixels; a tent of one pixel cuts it off."""
FIREFLY = 2.0
"""Largest ratio of an exposed sample to its brightest neighbour plus white."""
BRIGHTENING = 8.0
"""Exposed samples in a mean are at most white plus BRIGHTENING times the mean."""
MAX_STATIC_MOTION = 1.0 / 256.0
"""Longest motion of a static sample, render pixels."""
PERIOD = 3.75
"""Weight of a jitter period in the mean. After two periods the first makes up 58 % of the mean, 1 / sqrt(3),
and the second 42 %, so that parts of a later period change it less. After a frame that opened a pixel, the
mean keeps at most the weight of one period."""
READY = 1.4
"""Weight from which on residuals are measured, and the image fades from the method's to the mean. The fade
ends at PERIOD."""
PATTERN_READY = 2.5
"""Weight from which on its pattern is compared: a mean of few samples has a pattern of its own."""
LEARNED = 12.0
"""Samples per display pixel, of which the range of the residuals is learned."""
MARGIN = 1.5 / 255.0
"""Of the shown luma: distance to the range that opens."""
MARGIN_LEARNING = 8.0 / 255.0
"""The same while it is learned, beside SPREADS times the deviation of the differences in the 5x5 samples."""
SPREADS = 1.5
"""Where patterns are finer than a sample, differences deviate most, and their means vary most with jitter."""
MOST_LEARNING = 48.0 / 255.0
"""Upper limit of the sum: on such patterns, too, a change of light opens while the range is learned."""
LEAST_CONTRAST = 9.0 / 255.0
"""Of the shown luma: least deviation of the mean in the 5x5 samples, at which its pattern is compared."""
LEAST_RELATIVE_CONTRAST = 0.05
"""Least variance of the mean there beside it, by that of the differences: of a pattern finer than a pixel the
mean is nearly flat, and what the samples follow is chance."""
FOLLOWS = -0.1
"""Slope of the samples on the mean in the 5x5 samples below which they follow another pattern. It is about 1
where the mean is right, and 0 on average where the two have nothing in common."""
FOLLOWS_DOUBTED = 0.3
"""The same in a mean that is doubted already: the second frame confirms most of what the first doubted."""
DOUBTED = 0.5
"""What opens where samples follow another pattern; 1 where they leave the range. In one frame the former may
be chance: the image still shows the mean, and the sample is added."""
UNBOUNDED = 4.0
"""Limit of the range that no residual passes: the frame after one that opened opens on the same side only."""


def converged_of(static_mean: Float32) -> Float32:
    """Return the map `converged`, (H, W), of the step that wrote the history tensor `static_mean`."""
    converged: Float32 = np.clip((static_mean[0, 3] - READY) / (PERIOD - READY), 0.0, 1.0)
    return converged
