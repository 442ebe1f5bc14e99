"""What the stages of `gbuffer` hand to one another."""

from typing import NamedTuple

from torch import Tensor

from supersampler_model.methods.gbuffer.network import Seen
from supersampler_model.ops.sampling import View

PAST_NORMAL = slice(13, 16)  # of what is seen beside a frame of the past


class Surfaces(NamedTuple):
    """What is seen at each pixel, of either size."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    roughness: Tensor  # (1, 1, h, w) in [0, 1], as the next two
    metallic: Tensor
    specular: Tensor
    depth: Tensor  # (1, 1, h, w) reversed


class Samples(NamedTuple):
    """This frame's samples around each display pixel: nine, row by row."""

    colors: list[Tensor]  # of (1, 3, H, W), what they show over what their surface reflects, toned
    weights: list[Tensor]  # of (1, 1, H, W), by distance and by how like the pixel's surface theirs is
    likeness: Tensor  # (1, 1, H, W) sum of the weights, about 1 where a surface like the pixel's was hit


class Present(NamedTuple):
    """This frame."""

    toned: Tensor  # (1, 3, h, w) exposed colour; 0 where it is not usable
    usable: Tensor  # (1, 1, h, w)
    motion: Tensor  # (1, 2, h, w)
    render: Surfaces
    display: Surfaces
    reflectance: Tensor  # (1, 3, H, W) of the display pixels' surfaces
    samples: Samples
    guided: Tensor  # (1, 3, H, W) their mean on each pixel's surface, toned
    smooth: Tensor  # (1, 3, H, W) their mean by distance alone, toned
    near: Tensor  # (1, 3, H, W) those nearest, toned: what edges are made of, frame after frame
    confidence: Tensor  # (1, 1, H, W) how near they are, [0, 1]
    view: View
    exposure: Tensor  # (1,) > 0
    followed: Tensor  # (1,) the same for the history, see `exposure_for`


class Remembered(NamedTuple):
    """The warped past at display size, toned RGB."""

    color: Tensor  # (1, 3, H, W) by the motion of what is in front
    own: Tensor  # (1, 3, H, W) by the pixel's own motion
    relit: Tensor  # (1, 3, H, W) the same, with what this frame's surface reflects
    counted: Tensor  # (1, 1, H, W) how many samples it is made of; 0 where there is no past
    surface: Tensor  # (1, 1, H, W) 1 where it may show what is there now


class History(NamedTuple):
    """What the frame before left; shapes as in `GBuffer.history`."""

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
    """All that is known before the network speaks."""

    seen: Seen
    present: Present
    past: Remembered
    frame: Tensor  # (1, FRAME, h, w) this frame, for the history

    @property
    def past_normal(self) -> Tensor:
        """(1, 3, h, w) of the frame before, warped; 0 where it is of no use."""
        return self.seen.beside[:, PAST_NORMAL]


class Finished(NamedTuple):
    """What a step draws and remembers."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: History
    weight: Tensor  # (1, 1, H, W) share of the past in the image
