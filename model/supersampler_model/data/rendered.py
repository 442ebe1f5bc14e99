"""The renderer's output for one frame: inputs of upscalers, reference, statistics for labels."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler.frame import Size
from supersampler.io.shot import ClassMaps
from supersampler_model.data.labels import LabelInputs, PixelStatistics, label

UNIT_BUFFERS = ("base_color", "roughness", "metallic", "specular")
"""G-buffers in [0, 1]; they are stored with eight bits, as in engines."""
Float16: TypeAlias = NDArray[np.float16]
Float32: TypeAlias = NDArray[np.float32]


def render_size(display_size: Size, ratio: float) -> Size:
    """Return (width, height) of the frames at a ratio."""
    return round(display_size[0] / ratio), round(display_size[1] / ratio)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceBuffers:
    """Surfaces at one sample of each pixel: (h, w, ...). Row 0 is on top, x points right, y down.

    The surface at p was at p + motion[p] in the previous frame. Motion of points that were behind the camera
    points off screen.
    """

    depth: Float32  # (h, w) near / view distance; 0 at the sky
    motion: Float32  # (h, w, 2) pixels of this grid, without jitter, previous minus current
    previous_depth: Float32  # (h, w) depth of the surface in the previous frame, occluded or not
    base_color: Float16  # (h, w, 3) in [0, 1]
    normal: Float16  # (h, w, 3) world, unit length, normal map applied; 0 at the sky
    smooth_normal: Float16  # (h, w, 3) without the normal map
    roughness: Float16  # (h, w) in [0, 1], as the next two
    metallic: Float16
    specular: Float16

    def gbuffer(self, *, depth: bool = False) -> dict[str, NDArray[Any]]:
        """Return the buffers of `Frame.gbuffer` by name; with depth, those of `Frame.gbuffer_display`."""
        names = ("base_color", "normal", "roughness", "metallic", "specular", *(["depth"] * depth))
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelTruth:
    """Fractions of each pixel's samples, (h, w) each, in [0, 1]: the masks of quality measures."""

    thin_still: Float16  # samples on static thin objects
    thin_moving: Float16  # samples on moving thin objects
    moving: Float16  # samples on other moving objects
    unshadowed: Float16  # mean fraction of sun and spot light that is not in shadow; 1 without such light

    def planes(self) -> dict[str, Float16]:
        """Return the planes by name."""
        return {name: getattr(self, name) for name in self.__slots__}


AOVS = ("thin_still", "thin_moving")
"""Planes of `PixelTruth` that are AOVs in frames of shots with truth, so that methods blend them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendered:
    """One frame."""

    color: Float16  # (h, w, 3) linear RGB at render size, one sample per pixel, at pixel centre + jitter
    render: SurfaceBuffers  # the surfaces of those samples
    display: SurfaceBuffers  # surfaces at display size, at pixel centres
    reference: PixelStatistics  # at display size, with linear colours
    jitter: tuple[float, float]  # (x, y) render pixels, in [-0.5, 0.5]
    reset: bool  # True on the first frame after a cut
    exposure: float  # factor of the colour before the tone curve
    samples_truth: PixelTruth | None = None  # truth of the samples of `color`; None unless requested
    truth: PixelTruth | None = None  # truth of the reference's pixels; None unless requested

    def frame(self) -> Frame:
        """Return the input of an `Upscaler`."""
        return input_frame(
            self.color, self.render, self.display, jitter=self.jitter, reset=self.reset,
            exposure=self.exposure,
        )  # fmt: skip

    def label_inputs(self, exposure: float | None = None) -> LabelInputs:
        """Return the inputs of the label rules, toned at an exposure; None: the frame's own."""
        return LabelInputs(
            pixels=self.reference.toned(self.exposure if exposure is None else exposure),
            motion=self.display.motion, depth_before=self.display.previous_depth, cut=self.reset,
        )  # fmt: skip


def labels_of(now: Rendered, before: Rendered | None) -> ClassMaps:
    """Return a frame's labels. Both frames are compared at its exposure: a new exposure is not new light."""
    previous = None if before is None else before.label_inputs(now.exposure)
    return label(now.label_inputs(now.exposure), previous)


def input_frame(
    color: Float16,
    render: SurfaceBuffers,
    display: SurfaceBuffers | None,
    *,
    jitter: tuple[float, float],
    reset: bool = False,
    exposure: float = 1.0,
) -> Frame:
    """Return the input of an `Upscaler`; `display` is only needed by methods that read G-buffers."""
    return Frame(
        color=color, depth=render.depth, motion=render.motion, jitter=jitter, reset=reset, exposure=exposure,
        gbuffer=render.gbuffer(), gbuffer_display=None if display is None else display.gbuffer(depth=True),
    )  # fmt: skip
