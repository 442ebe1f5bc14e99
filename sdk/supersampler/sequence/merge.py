"""The merge of a forward and a backward run: a mean, weighted by what each has gathered."""

from collections.abc import Collection

import numpy as np

from supersampler.arguments import ieee_arithmetic
from supersampler.backends.cpu.kernel_loader import kernel_if_possible
from supersampler.backends.cpu.structs import pack
from supersampler.frame import Float32
from supersampler.history import StepResult
from supersampler.sequence.kernels.structs import MergedImages

WEIGHT_MAPS = ("count", "converged")
"""Auxiliary outputs that `weight_of` reads, where a method has them."""
LEAST = 0.05
"""Lower bound of the sample count in a weight: weights stay positive."""
SETTLED = 4
"""Steps after which a run's image has its full weight."""
CONVERGED = 255.0
"""Further weight where an image is the mean of all samples of a static pixel: where one run has converged and
the other has not, the mean differs from it by less than an 8-bit step."""


def weight_outputs(maps: Collection[str]) -> tuple[str, ...]:
    """Return the auxiliary outputs to ask a step for, of those that a method has."""
    return tuple(name for name in WEIGHT_MAPS if name in maps)


@ieee_arithmetic
def weight_of(result: StepResult, steps: int) -> Float32:
    """Return the weight (H, W) of a run's image in the merge, > 0.

    It is the sample count, where a method has one, and less in a run's first steps: where a run has just
    begun, or what it knew was hidden, the other run's image counts for more, and elsewhere it is their mean.

    Args:
        result: with the outputs of `weight_outputs`.
        steps: of the run since its history began, this one too.
    """
    weight = np.full(result.image.shape[:2], min(steps / SETTLED, 1.0), np.float32)
    if result.count is not None:
        weight *= np.maximum(result.count, np.float32(LEAST))
    if result.converged is not None and result.converged.any():
        weight *= 1.0 + np.float32(CONVERGED) * np.square(result.converged)
    return weight


@ieee_arithmetic
def merge_images(
    image: Float32, other: Float32, weight: Float32, other_weight: Float32, exposure: float
) -> None:
    """Write the weighted mean of two images to `image`.

    The mean is that of c / (1 + max(c)), of exposed colours: of two linear values the brighter would count
    for more than a display shows.

    Args:
        image: (H, W, 3) float32 linear RGB of the forward run.
        other: the same of the backward run.
        weight: (H, W) of the first.
        other_weight: (H, W) of the other.
        exposure: of the frame.
    """
    kernel = kernel_if_possible("sequence.kernels.merge.merge_images")
    images = MergedImages(image, other, weight, other_weight, weight.size, exposure)
    if kernel is not None and all(array.flags.c_contiguous for array in images[:4]):
        kernel(pack(images))
        return
    tone, other_tone = (1.0 + np.float32(exposure) * each.max(axis=2) for each in (image, other))
    a, b = weight / tone, other_weight / other_tone
    image += (b / np.maximum(a + b, np.float32(1e-30)))[..., None] * (other - image)


@ieee_arithmetic
def merge_aovs(aovs: Float32, other: Float32, weight: Float32, other_weight: Float32) -> None:
    """Write the weighted mean of two blended AOVs, (H, W, k), to the first."""
    aovs += (other_weight / (weight + other_weight))[..., None] * (other - aovs)
