"""`guided-warp`: the colour of an unshaded frame, from the last shaded one.

The G-buffers of an unshaded frame give its surfaces; only the light is missing. It is taken from similar
surfaces of the last shaded frame (`guided.py`) and multiplied by each pixel's own reflectance. The image has
the samples and the jitter of the unshaded frame: an upscaler steps on it as on a shaded frame.
"""

from typing import ClassVar

from torch import Tensor

from supersampler.methods.extrapolation.spec import GUIDED_WARP, GuidedWarpConfig
from supersampler_model.methods.base import Method
from supersampler_model.methods.extrapolation.guided import (
    back_to_shaded,
    guided_light,
    reflectance,
    samples_at,
    shaded_of,
    surface_of,
)
from supersampler_model.ops.color import bounded
from supersampler_model.ops.size import render_size_of


class GuidedWarp(Method):
    """Light each pixel like similar surfaces of the last shaded frame.

    It takes no step on shaded frames: the history after one is that frame, see `after_shaded`. With a history
    of zeros the image is black. Samples with invalid colour, surface or depth are used only where there is no
    other.
    """

    spec: ClassVar = GUIDED_WARP
    config: GuidedWarpConfig

    def compute(
        self,
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        history_color: Tensor,  # (1, 3, h', w') linear RGB
        history_base_color: Tensor,  # (1, 3, h', w')
        history_normal: Tensor,  # (1, 3, h', w')
        history_depth: Tensor,  # (1, 1, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_motion: Tensor,  # (1, 2, h'', w'')
        history_motion_jitter: Tensor,  # (1, 2)
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, h, w), linear RGB >= 0, and the next history."""
        surface = surface_of(gbuffer_base_color, gbuffer_normal, depth)
        shaded = shaded_of(history_color, history_base_color, history_normal, history_depth, history_jitter)
        to_shaded = back_to_shaded(motion, jitter, history_motion, history_motion_jitter)
        x, y = samples_at(to_shaded, jitter, render_size_of(shaded.color), shaded.jitter)
        light = guided_light(surface, shaded, x, y, self.config)
        image = bounded(light * reflectance(surface, self.config))
        return (image, shaded.color, *shaded.surface, shaded.jitter * 1.0, to_shaded, jitter * 1.0)
