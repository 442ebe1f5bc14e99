"""`fsr2-like`: steps through frames by the passes of FSR2."""

from dataclasses import dataclass

import numpy as np

from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import usable_exposure
from supersampler_bench.fsr2 import locks, luminance_pyramid
from supersampler_bench.fsr2.accumulate import History, Passed, accumulate
from supersampler_bench.fsr2.buffers import View, inputs_of
from supersampler_bench.fsr2.depth_clip import depth_clip
from supersampler_bench.fsr2.dilate import dilate

FSR2_LIKE = "fsr2-like"
"""Name of the method in `bench quality`."""


@dataclass(frozen=True)
class _Before:
    """What the step on the previous frame passes to this one."""

    history: History
    motion: Array  # (h, w, 2), dilated, fractions of the image
    average_log: float


class Fsr2Like:
    """FSR 2.2 without sharpening and reactive masks; see docs/quality.md.

    Args:
        display_size: (width, height) of the images.
        frame_seconds: between two frames, by which the measured exposure follows the light.
    """

    def __init__(self, display_size: Size, frame_seconds: float = 1.0 / 60.0) -> None:
        self._display, self._seconds = display_size, frame_seconds
        self._before: _Before | None = None

    def step(self, frame: Frame) -> Float32:
        """Return the image (H, W, 3), linear RGB in [0, 65504].

        Raises:
            FrameError: the frame has no colour.
        """
        inputs = inputs_of(frame)
        view = View(frame.size, self._display, frame.jitter)
        before = None if frame.reset else self._before
        logs = luminance_pyramid.log_luma(inputs.color, view)
        previous_average = before.average_log if before else None
        average = luminance_pyramid.followed_average(logs, previous_average, self._seconds)
        exposure = usable_exposure(frame.exposure) or luminance_pyramid.auto_exposure(average)
        dilated = dilate(inputs.depth, inputs.motion, view)
        motion = view.of_image(dilated.motion)
        previous_motion = before.motion if before else np.zeros_like(motion)
        passed = Passed(
            color=inputs.color,
            motion=dilated.motion,
            clip=depth_clip(inputs, dilated, previous_motion, view),
            made=locks.new_locks(locks.lock_luma(inputs.color, exposure), view),
            shading=luminance_pyramid.shading_luma(luminance_pyramid.shading_grid(logs), exposure, view),
            exposure=exposure,
        )
        history = accumulate(passed, before.history if before else None, view)
        self._before = _Before(history, motion, average)
        return np.ascontiguousarray(history.color[..., :3], np.float32)
