"""Constants of the temporal denoiser, which its torch definition and its kernel share."""

from typing import NamedTuple

REACH = 5
"""Frames to either side that an image depends on."""
ACCUMULATED = 2.0
"""Factor of the samples per pixel where means are averaged: a mean is of more samples than a frame."""
LOG_OFFSET = 0.01
"""Added to exposed colour before its logarithm: differences in the dark below it do not matter."""
LIGHT_LIMIT = 0.17
"""Limit of the relative difference of colour at a pixel, where a change of light is measured: larger
differences are clamped."""
LIGHT_NOISE = 0.024
"""Squared change of light times samples per pixel at which half of the change is corrected. Smaller changes
may be noise."""
AGREEMENT = 0.35
"""Sum of the weights of all neighbours above which the denoised mean is used alone. Below it, the mean is
blended with the frame denoised by itself: OIDN takes noise for detail where little was averaged."""
KNOWN_SHARE = 0.999
"""Minimum interpolated fraction of known samples at the end of a path; below it the path is ignored."""
DEFAULT_SAMPLES = 8
"""Samples per pixel that are assumed where the frames do not state theirs."""
MAX_SAMPLES = 64
"""Upper limit of the samples per pixel that the filter uses. With adaptive sampling a renderer states its own
limit, often thousands, and not the samples it took."""


class Weights(NamedTuple):
    """Constants of the weights of neighbours.

    The weight of a neighbour is exp(log_weight - age * its age - samples * its distance), with the samples
    per pixel, and the sum of its distances times their costs. The frame itself has 1. The variance of noise
    falls with the samples: what may be noise at one sample is a difference at eight.

    Attributes:
        log_weight: logarithm of the weight of a neighbour that agrees, without its age.
        color, color_3x3, color_5x5: costs of the squared difference of log colour, at the pixel and averaged
            over 3x3 and 5x5 pixels.
        normal, normal_3x3: costs of the squared difference of normals, at the pixel and averaged over 3x3.
        albedo, albedo_3x3: costs of the squared difference of albedo, at the pixel and averaged over 3x3.
        shift_9x9: cost of the squared mean difference of log colour over 9x9 pixels and three channels. Noise
            averages out, a change of light does not. Small changes are corrected (`LIGHT_NOISE`), so this
            cost matters for large ones.
        age: cost of a frame of distance in time.
    """

    log_weight: float
    color: float
    color_3x3: float
    color_5x5: float
    normal: float
    normal_3x3: float
    albedo: float
    albedo_3x3: float
    shift_9x9: float
    age: float


OF_DENOISED = Weights(-0.6249, 0.0220, 0.1223, 0.2019, 0.3178, 0.6003, 0.5483, 0.9074, 1.0483, 0.7610)
"""Weights that average denoised frames, fitted by `supersampler_model.denoising.training`. Its shift_9x9 was
multiplied by 0.3 when small changes of light were first corrected."""
OF_NOISY = Weights(0.0, 0.0220, 0.1223, 0.2019, 0.95, 1.8, 1.65, 2.7, 0.315, 0.875)
"""Weights that average noisy frames, whose mean is denoised afterwards. They are those of OF_DENOISED with
groups of costs scaled by the best factors of a search on renders of `denoise_scenes.py --variant 1`.
Neighbours count more, because they remove noise, but less across edges, where errors of motion would blur
detail."""
