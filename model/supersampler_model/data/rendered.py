"""The renderer's output for one frame: inputs of upscalers, reference, statistics for labels."""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler_model.data.labels import LabelInputs, Labels, PixelStatistics, label

UNIT_BUFFERS = ("base_color", "roughness", "metallic", "specular")
"""G-buffers in [0, 1]; they are stored with eight bits, as in engines."""
Float16: TypeAlias = NDArray[np.float16]
Float32: TypeAlias = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceBuffers:
    """Surfaces at each pixel, by one sample: (h, w, ...). Row 0 is on top, x points right, y down.

    Attributes:
        depth: (h, w) near / view distance; 0 at the sky.
        motion: (h, w, 2) pixels of this grid, without jitter, previous minus current: the surface at p was
            at p + motion[p] one frame ago. Motion of points that were behind the camera points off screen.
        previous_depth: (h, w) the depth that the surface had a frame ago, occluded or not.
        base_color: (h, w, 3) in [0, 1].
        normal: (h, w, 3) world, unit length, normal map applied; 0 at the sky.
        smooth_normal: (h, w, 3) the same without the normal map.
        roughness, metallic, specular: (h, w) in [0, 1].
    """

    depth: Float32
    motion: Float32
    previous_depth: Float32
    base_color: Float16
    normal: Float16
    smooth_normal: Float16
    roughness: Float16
    metallic: Float16
    specular: Float16

    def gbuffer(self, *, depth: bool = False) -> dict[str, NDArray[Any]]:
        """Return the buffers of `Frame.gbuffer` by name, or with depth those of `Frame.gbuffer_display`."""
        names = ("base_color", "normal", "roughness", "metallic", "specular", *(["depth"] * depth))
        return {name: getattr(self, name) for name in names}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PixelTruth:
    """Fractions of each pixel's samples, (h, w) each, in [0, 1]: measures of quality take masks from them.

    Attributes:
        thin_still: that hit thin objects at rest in the world.
        thin_moving: that hit thin objects that move.
        moving: that hit other moving objects.
        unshadowed: the mean over the samples of the fraction of sun and spot light that no shadow takes; 1
            where neither would arrive.
    """

    thin_still: Float16
    thin_moving: Float16
    moving: Float16
    unshadowed: Float16

    def planes(self) -> dict[str, Float16]:
        """Return the planes by name."""
        return {name: getattr(self, name) for name in self.__slots__}


AOVS = ("thin_still", "thin_moving")
"""Planes of `PixelTruth` that frames of shots with truth have as AOVs, so that methods blend them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rendered:
    """One frame.

    Attributes:
        color: (h, w, 3) linear RGB at render size, one sample a pixel, taken at pixel centre + jitter.
        render: the surfaces of those samples.
        display: the same at display size, at pixel centres without jitter.
        reference: reference at display size; its colours are linear.
        jitter: (x, y) render pixels, in [-0.5, 0.5].
        reset: True on the first frame after a cut.
        exposure: factor of the colour before the tone curve.
        samples_truth: truth of the samples of `color`, 0 or 1 but for the light; None unless requested.
        truth: truth of the reference's pixels; None unless requested.
    """

    color: Float16
    render: SurfaceBuffers
    display: SurfaceBuffers
    reference: PixelStatistics
    jitter: tuple[float, float]
    reset: bool
    exposure: float
    samples_truth: PixelTruth | None = None
    truth: PixelTruth | None = None

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


def labels_of(now: Rendered, before: Rendered | None) -> Labels:
    """Return a frame's labels. Both frames are compared at its exposure, which does not change the light."""
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
