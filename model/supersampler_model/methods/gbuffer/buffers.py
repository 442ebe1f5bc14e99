"""Tensors that the stages of `gbuffer` pass to each other."""

from typing import NamedTuple

from torch import Tensor

from supersampler_model.methods.gbuffer.network import NetworkInputs
from supersampler_model.ops.sampling import View

PREVIOUS_NORMAL = slice(13, 16)  # channels of `NetworkInputs.refiner_inputs`


class Surfaces(NamedTuple):
    """G-buffers, at render or display size."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    roughness: Tensor  # (1, 1, h, w) in [0, 1], as the next two
    metallic: Tensor
    specular: Tensor
    depth: Tensor  # (1, 1, h, w) reversed


class Samples(NamedTuple):
    """This frame's samples around each display pixel: nine, row by row."""

    colors: list[Tensor]  # of (1, 3, H, W), colour over reflectance, toned
    weights: list[Tensor]  # of (1, 1, H, W), by distance and similarity of the surfaces
    likeness: Tensor  # (1, 1, H, W) sum of the weights, about 1 where a similar surface was sampled


class CurrentFrame(NamedTuple):
    """This frame."""

    toned: Tensor  # (1, 3, h, w) exposed colour; 0 where it is not usable
    usable: Tensor  # (1, 1, h, w)
    motion: Tensor  # (1, 2, h, w)
    render: Surfaces
    display: Surfaces
    reflectance: Tensor  # (1, 3, H, W) of the display pixels' surfaces
    samples: Samples
    guided: Tensor  # (1, 3, H, W) their mean times the pixel's reflectance, toned
    smooth: Tensor  # (1, 3, H, W) mean colour by distance alone, toned
    near: Tensor  # (1, 3, H, W) mean of the samples near the pixel, toned: accumulated, it gives the edges
    confidence: Tensor  # (1, 1, H, W) sum of their Gaussian weights, [0, 1]
    view: View
    exposure: Tensor  # (1,) > 0
    followed: Tensor  # (1,) signed exposure for the history, see `exposure_for`


class WarpedHistory(NamedTuple):
    """The warped history at display size, toned RGB."""

    color: Tensor  # (1, 3, H, W) by the dilated motion
    own: Tensor  # (1, 3, H, W) by the pixel's own motion
    relit: Tensor  # (1, 3, H, W) the same, divided by the old and multiplied by the new reflectance
    counted: Tensor  # (1, 1, H, W) number of accumulated samples; 0 without history
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible


class History(NamedTuple):
    """The history tensors; shapes as in `GBuffer.history`."""

    color: Tensor
    reflectance: Tensor
    counted: Tensor
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
    frame: Tensor  # (1, FRAME, h, w) this frame, for the history

    @property
    def previous_normal(self) -> Tensor:
        """(1, 3, h, w) normals of the previous frame, warped; 0 where they are masked."""
        return self.inputs.refiner_inputs[:, PREVIOUS_NORMAL]


class Finished(NamedTuple):
    """Results of the finish stage."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: History
    weight: Tensor  # (1, 1, H, W) weight of the history in the image
