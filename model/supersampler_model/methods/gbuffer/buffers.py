"""Tensors that the stages of `gbuffer` pass to each other.

Surfaces but for their depth, and colours of this frame at display size, are half floats in a method of half
precision; all others are float32.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.methods.gbuffer.network import NetworkInputs
from supersampler_model.ops.sampling import View

PREVIOUS_NORMAL = slice(13, 16)
"""Channels of `NetworkInputs.refiner_inputs` with the normals of the previous frame."""


class Surfaces(NamedTuple):
    """G-buffers, at render or display size."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    roughness: Tensor  # (1, 1, h, w) in [0, 1], as the next two
    metallic: Tensor
    specular: Tensor
    depth: Tensor  # (1, 1, h, w) reversed


class FrameInputs(NamedTuple):
    """The inputs of one frame."""

    color: Tensor  # (1, 3, h, w) linear RGB
    motion: Tensor  # (1, 2, h, w) render pixels, previous minus current
    exposure: Tensor  # (1,) 0: measure
    render: Surfaces
    display: Surfaces
    view: View


class Samples(NamedTuple):
    """The 3x3 samples of this frame around each display pixel, row by row."""

    colors: list[Tensor]  # of (1, 3, H, W), colour over reflectance, toned
    weights: list[Tensor]  # of (1, 1, H, W), by distance and similarity of the surfaces
    similarity: Tensor  # (1, 1, H, W) sum of the weights, about 1 where a similar surface was sampled


class CurrentFrame(NamedTuple):
    """This frame, sanitized and resampled at the display pixels."""

    toned: Tensor  # (1, 3, h, w) exposed colour after the tone curve; 0 where it is not usable
    usable: Tensor  # (1, 1, h, w) 1 where the colour is valid, else 0
    inputs: FrameInputs  # sanitized, with the exposure to use
    reflectance: Tensor  # (1, 3, H, W) of the display pixels' surfaces
    samples: Samples
    guided: Tensor  # (1, 3, H, W) weighted mean of `samples` times the pixel's reflectance, toned
    smooth: Tensor  # (1, 3, H, W) mean colour under a wide Gaussian, toned
    near: Tensor  # (1, 3, H, W) mean colour under a narrow Gaussian, toned; its average over frames is sharp
    confidence: Tensor  # (1, 1, H, W) sum of the weights of `near`, [0, 1]
    followed: Tensor  # (1,) signed exposure for the history, see `exposure_for`


class WarpedHistory(NamedTuple):
    """The warped history at display size; colours are toned RGB."""

    color: Tensor  # (1, 3, H, W) warped by the dilated motion
    own: Tensor  # (1, 3, H, W) warped by the pixel's own motion
    relit: Tensor  # (1, 3, H, W) `own`, divided by the previous reflectance and multiplied by the current one
    sample_count: Tensor  # (1, 1, H, W) number of accumulated samples; 0 without history
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible


class History(NamedTuple):
    """The history tensors; shapes as in `GBuffer.history`."""

    color: Tensor
    reflectance: Tensor
    sample_count: Tensor
    frame: Tensor
    frame_before: Tensor
    motion: Tensor
    jitter: Tensor
    jitter_before: Tensor
    exposure: Tensor


class Gathered(NamedTuple):
    """Results of the gather stage."""

    inputs: NetworkInputs
    current: CurrentFrame
    warped: WarpedHistory
    frame: Tensor  # (1, FRAME, h, w) the channels of this frame that the history stores
    reactive: Tensor = torch.zeros(())  # (1, 1, H, W) of `reactive_at`

    @property
    def previous_normal(self) -> Tensor:
        """(1, 3, h, w) warped normals of the previous frame; 0 where they are masked."""
        return self.inputs.refiner_inputs[:, PREVIOUS_NORMAL]


class Finished(NamedTuple):
    """Results of the finish stage."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: History
    weight: Tensor  # (1, 1, H, W) weight of the history in the image
