"""Downsampling of an image that is larger than the display: a Lanczos filter on toned colours."""

import torch
from torch import Tensor

from supersampler.methods.classifier_large.spec import REACH, SHARPNESS
from supersampler_model.ops.color import TONED, bounded, inverse_tone, tone
from supersampler_model.ops.sampling import Bands, bands, resample, span
from supersampler_model.ops.size import Size, render_size_of


def downsample(image: Tensor, display: Size, exposure: Tensor) -> Tensor:
    """Filter an image to the size of the display.

    Args:
        image: (1, 3, H', W') linear RGB, at most 1.4 times the display, per axis.
        display: (width, height) of the result.
        exposure: (1,) > 0. Colours are filtered as a screen shows them: dark sides of bright edges stay dark.

    Returns:
        (1, 3, H, W) linear RGB.
    """
    large = render_size_of(image)
    across, down = (_filter(size, extent, image) for size, extent in zip(large, display, strict=True))
    toned = resample(tone(image * exposure), across, down)
    return bounded(inverse_tone(toned.clamp(0.0, TONED[torch.float32])) / exposure)


def _filter(size: int, outputs: int, like: Tensor) -> Bands:
    """Weights of one axis, of sum 1."""
    pixel = torch.arange(outputs, device=like.device)
    position = (pixel + 0.5) * size / outputs - 0.5
    scale = SHARPNESS * outputs / size
    found = bands(position, size, span(size, outputs), lanczos, reach=REACH, scale=scale)
    return found._replace(weights=found.weights / found.weights.sum(dim=2, keepdim=True))


def lanczos(distance: Tensor) -> Tensor:
    """Lanczos filter of two lobes, support 2, as the polynomial that FSR uses in place of sines."""
    squared = (distance * distance).clamp(max=4.0)
    base, window = 0.4 * squared - 1.0, 0.25 * squared - 1.0
    return (1.5625 * base * base - 0.5625) * window * window
