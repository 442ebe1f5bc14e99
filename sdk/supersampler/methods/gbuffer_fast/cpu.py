"""CPU backend of `gbuffer-fast`: that of `classifier` with kernels of the variant `guided`."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from supersampler.backends.cpu.executor import Step
from supersampler.backends.cpu.frame_preprocess import ResampledFrame
from supersampler.backends.cpu.history import HistoryLayout, Plane
from supersampler.backends.cpu.layout import CLASSIFIER_PIXEL, LANES, PAD, SURFACE_PLANES
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import Filter, Kernel, gaussian, up_to
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import Rect, RectTask, ThreadPool
from supersampler.frame import Array, Float32, Size
from supersampler.methods.classifier.cpu import ClassifierCpu
from supersampler.methods.classifier.structs import Guide
from supersampler.methods.gbuffer_fast.spec import GBUFFER_FAST, GBUFFERS_READ
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_info import ModelInfo

_KERNELS = "methods.classifier.kernels.guided"
PREPARE_SURFACES, PREPARE_DEPTH = f"{_KERNELS}.prepare_surfaces", f"{_KERNELS}.prepare_depth"


class GuidedFrame(ResampledFrame):
    """A resampled frame, and buffers for its surfaces.

    Attributes:
        surfaces: (render height, SURFACE_PLANES, padded width) the samples; see `Guide`.
        depth: (display height, PAD + pitch + PAD) depth of the display's pixels; see `Guide`.
    """

    def __init__(
        self, render: Size, display: Size, filters: Sequence[Filter], threads: int, windows: Sequence[Kernel]
    ) -> None:
        super().__init__(render, display, filters, threads, windows)
        self.surfaces = aligned((render[1], SURFACE_PLANES, self.padded_width))
        self.depth = aligned((display[1], up_to(display[0], LANES) + 2 * PAD))


class GuidedCpu(ClassifierCpu):
    """Runs `gbuffer-fast`; see `ClassifierCpu`."""

    layout: ClassVar = HistoryLayout(
        GBUFFER_FAST,
        {
            "pixels": Plane(("color", "state"), CLASSIFIER_PIXEL),
            "classes": Plane(("classes",), 8, np.uint8),
            "depth": Plane(("depth",), 2),
            "reflectance": Plane(("reflectance",), 4, np.uint8),
        },
        glare="state",
    )
    guided: ClassVar = True
    preparing: ClassVar = (PREPARE_SURFACES, PREPARE_DEPTH)

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        super().__init__(info, pool)
        c = info.config
        self._windows = [gaussian(c["guide_sigma"])]
        falloffs = c["normal_falloff"], c["base_color_falloff"]
        normal_scale, color_scale = (float(falloff) ** 0.5 for falloff in falloffs)
        self._scales = normal_scale, color_scale, 0.5 / c["depth_sigma"] ** 2, c["min_reflectance"]

    def _space(self, render: Size, display: Size) -> GuidedFrame:
        return GuidedFrame(render, display, self._filters, self.pool.threads, self._windows)

    def guide_of(self, step: Step, view: ResampledFrame) -> Guide:
        """Prepare the surfaces of a frame."""
        assert isinstance(view, GuidedFrame)  # noqa: S101 - from `_space`
        frame, (w, h), (big_w, big_h) = step.frame, step.frame.size, step.display
        base_color, normal, display_color, display_normal, depth = (
            self._single(GBUFFERS[name].find(frame)) for name in GBUFFERS_READ
        )
        before, after = (history.arrays["reflectance"] for history in (step.history, step.next_history))
        guide = Guide(
            view.surfaces, display_color, display_normal, view.depth, before, after.view(np.int32),
            *self._scales,
        )  # fmt: skip
        inputs, packed = pack(step.inputs), pack(guide)
        surfaces, depths = (self.kernels[name] for name in self.preparing)
        pitch = view.depth.shape[1] - 2 * PAD

        def prepare_samples(box: Rect, _: int) -> None:
            surfaces(
                inputs, address(base_color), address(normal), packed, w, view.padded_width, box.y0, box.y1
            )

        def prepare_depth(box: Rect, _: int) -> None:
            depths(address(depth), big_w, pitch, box.y0, box.y1, address(view.depth))

        self.pool.run_tasks(
            "preprocess",
            RectTask([Rect(0, h, 0, 1)], prepare_samples),
            RectTask([Rect(0, big_h, 0, 1)], prepare_depth),
        )
        return guide

    def _single(self, image: Array | None) -> Float32:
        """Return an image that kernels read; all threads convert half floats, which takes a while."""
        assert image is not None  # noqa: S101 - checked before the step
        if image.dtype == np.float32 and image.flags.c_contiguous:
            return image
        made = np.empty(image.shape, np.float32)

        def convert(y0: int, y1: int, _: int) -> None:
            made[y0:y1] = image[y0:y1]

        self.pool.run_rows("preprocess", len(made), convert)
        return made
