"""Tensors on a device as frames, and back: what `Upscaler.step_tensors` takes and returns."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import image_of, pixels_of, planes_of
from supersampler.backends.onnx.tensors import Tensor, taken
from supersampler.errors import FrameError
from supersampler.frame import Float32, Frame
from supersampler.methods.gbuffers import GBUFFERS, grouped, names_of

_IMAGES = ("color", "depth", "motion")


def frame_of_tensors(
    tensors: Mapping[str, Tensor],
    jitter: tuple[float, float],
    exposure: float | None,
    *,
    reset: bool,
    inputs: Collection[str],
) -> Frame:
    """Return tensors as a frame, copied from the device.

    Args:
        tensors: by name.
        jitter: see `Frame`.
        exposure: see `Frame`.
        reset: see `Frame`.
        inputs: names of the tensors that the method reads. Depth and motion may be missing if it does not
            read them, and are 0 in the frame; other G-buffers are left out.

    Raises:
        FrameError: a tensor is missing, or of a wrong type, shape or range.
    """
    images: dict[str, Any] = {}
    gbuffers = [name for name in inputs if name in GBUFFERS]
    for name in (*_IMAGES, *gbuffers):
        if name not in tensors and name in ("depth", "motion") and name not in inputs:
            images[name] = np.zeros_like(images["color"][..., 0 if name == "depth" else slice(2)])
            continue
        if name not in tensors:
            raise FrameError(name, got=None, want="a tensor")
        planes: Float32 = taken(tensors[name], name).numpy()
        if planes.ndim != 4 or planes.shape[0] != 1:
            raise FrameError(name, got=planes.shape, want="(1, c, h, w)")
        images[name] = pixels_of(planes)
    gbuffer, gbuffer_display = grouped({name: images.pop(name) for name in gbuffers})
    return Frame(
        **images,
        jitter=jitter,
        exposure=exposure,
        reset=reset,
        gbuffer=gbuffer,
        gbuffer_display=gbuffer_display,
    )


def tensors_of_frame(frame: Frame, device: str) -> dict[str, Tensor]:
    """Undo `frame_of_tensors`, on a device as `Model.device` names it."""
    images = {name: planes_of(image_of(frame, name)) for name in (*_IMAGES, *names_of(frame))}
    return {name: ort.OrtValue.ortvalue_from_numpy(planes, device, 0) for name, planes in images.items()}


def image_of_tensor(image: Tensor) -> Float32:
    """Return (H, W, 3) of (1, 3, H, W), copied from the device."""
    return pixels_of(taken(image, "image").numpy())
