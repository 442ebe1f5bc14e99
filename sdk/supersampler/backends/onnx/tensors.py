"""Tensors of other libraries (torch, CuPy, JAX), shared with a graph by DLPack without copies."""

from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import IMAGE_SIZES, is_image_size
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import ORT_TYPES, image_of, pixels_of, planes_of
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.gbuffers import GBUFFERS, check_image_names, frame_of, gbuffer_arrays
from supersampler.methods.model_info import TensorInfo

_IMAGES = ("color", "depth", "motion")


class Tensor(Protocol):
    """A tensor with DLPack, which `torch.from_dlpack` and its equivalents accept without a copy."""

    def __dlpack__(self, *, stream: Any = None) -> Any:
        """Return a capsule with the tensor."""

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return the kind and the number of its device."""


def checked_tensors(tensors: Mapping[str, Tensor]) -> Mapping[str, Tensor]:
    """Return a frame's tensors, without a mask that is None.

    Raises:
        ArgumentError: it is not a mapping.
        FrameError: a name is unknown.
    """
    if not isinstance(tensors, Mapping):
        raise ArgumentError("tensors", got=shown(tensors), want="a mapping of names to tensors")
    check_image_names("tensors", tensors)
    return {name: tensor for name, tensor in tensors.items() if name != "reactive" or tensor is not None}


def ort_value_of(
    tensor: Tensor, name: str, error: type[FrameError] | type[ArgumentError] = FrameError
) -> "ort.OrtValue":
    """Return a value of ONNX Runtime that shares a tensor's memory.

    Raises:
        FrameError: the tensor cannot be shared; or another `error`.
        ArgumentError: this version of ONNX Runtime cannot share tensors.
    """
    if not hasattr(ort.OrtValue, "from_dlpack"):
        want = "one whose OrtValue has from_dlpack"
        raise ArgumentError("onnxruntime", got=ort.__version__, want=want, hint="Install a newer one.")
    try:
        return ort.OrtValue.from_dlpack(tensor)
    except Exception as problem:  # each library raises its own types
        want = "a contiguous tensor with DLPack (torch: detached)"
        got = f"{type(tensor).__name__} ({' '.join(str(problem).split())})"
        raise error(name, got=got, want=want) from problem


def shares_memory(one: "ort.OrtValue", other: "ort.OrtValue") -> bool:
    """Return whether two contiguous tensors overlap."""
    start, other_start = one.data_ptr(), other.data_ptr()
    end, other_end = start + one.tensor_size_in_bytes(), other_start + other.tensor_size_in_bytes()
    return bool(start < other_end and other_start < end)


def graph_inputs(
    infos: Iterable[TensorInfo],
    tensors: Mapping[str, Tensor],
    vectors: Mapping[str, NDArray[Any]],
    device: str,
) -> "dict[str, ort.OrtValue]":
    """Return the inputs of a graph by name: a frame's tensors, and `vectors`; a missing mask is zeros.

    Raises:
        FrameError: a tensor is missing or cannot be shared.
    """
    values = {}
    for info in infos:
        if info.name in vectors:
            values[info.name] = ort.OrtValue.ortvalue_from_numpy(vectors[info.name])
        elif info.name == "reactive" and info.name not in tensors:
            values[info.name] = _zeros(render_size_of(values["color"]), device)
        elif info.name not in tensors:
            raise FrameError(info.name, got=None, want=f"a tensor {info.shape}")
        else:
            values[info.name] = ort_value_of(tensors[info.name], info.name)
    return values


@lru_cache(2)
def _zeros(size: Size, device: str) -> "ort.OrtValue":
    """Return a reactive mask of zeros; it is shared, as graphs only read it."""
    return ort.OrtValue.ortvalue_from_numpy(np.zeros((1, 1, *size[::-1]), np.float32), device, 0)


def render_size_of(color: "ort.OrtValue") -> Size:
    """Return (width, height) of a frame's colour, (1, 3, h, w).

    Raises:
        FrameError: the tensor does not have four axes, or is empty or too large.
    """
    shape = color.shape()
    if len(shape) != 4 or not is_image_size(shape[3], shape[2]):
        raise FrameError("color", got=tuple(shape), want=f"(1, 3, h, w), h and w {IMAGE_SIZES}")
    return shape[3], shape[2]


def size_of_tensors(tensors: Mapping[str, Tensor]) -> Size:
    """Return (width, height) of a frame whose inputs are tensors.

    Raises:
        FrameError: "color" is missing; or see `render_size_of`.
    """
    if "color" not in tensors:
        raise FrameError("color", got=None, want="a tensor (1, 3, h, w)")
    return render_size_of(ort_value_of(tensors["color"], "color"))


def check_tensor(
    value: "ort.OrtValue",
    info: TensorInfo,
    shape: tuple[int, ...],
    device: str,
    name: str,
    error: type[FrameError] | type[ArgumentError] = FrameError,
) -> None:
    """Raise `error` unless the value `name` has the type, shape and device that the graph needs."""
    got = value.data_type(), tuple(value.shape()), value.device_name().lower()
    wanted = ORT_TYPES[info.type], shape, device
    if got != wanted:
        texts = [f"{kind} {extents} on {place}" for kind, extents, place in (got, wanted)]
        raise error(name, got=texts[0], want=texts[1])


def frame_of_tensors(tensors: Mapping[str, Tensor], inputs: Collection[str], **values: Any) -> Frame:
    """Return a frame with copies of tensors in CPU memory, and these `gbuffers.VALUES`.

    `inputs` are the names of the tensors that the method reads. Others are ignored. Depth and motion that are
    neither given nor read are 0.

    Raises:
        FrameError: a tensor is missing, or has a wrong type, shape or range.
    """
    images: dict[str, Any] = {}
    gbuffers = [name for name in inputs if name in GBUFFERS]
    masks = ["reactive"] if "reactive" in tensors and "reactive" in inputs else []
    for name in (*_IMAGES, *masks, *gbuffers):
        if name not in tensors and name in ("depth", "motion") and name not in inputs:
            images[name] = np.zeros_like(images["color"][..., 0 if name == "depth" else slice(2)])
            continue
        if name not in tensors:
            raise FrameError(name, got=None, want="a tensor")
        planes: Float32 = ort_value_of(tensors[name], name).numpy()
        if planes.ndim != 4 or planes.shape[0] != 1:
            raise FrameError(name, got=planes.shape, want="(1, c, h, w)")
        images[name] = pixels_of(planes)
    return frame_of(images, **values)


def tensors_of_frame(frame: Frame, device: str) -> dict[str, Tensor]:
    """Return copies of a frame's images as tensors on a device; see `Model.device`."""
    masks = [] if frame.reactive is None else ["reactive"]
    images = {name: planes_of(image_of(frame, name)) for name in (*_IMAGES, *masks, *gbuffer_arrays(frame))}
    return {name: ort.OrtValue.ortvalue_from_numpy(planes, device, 0) for name, planes in images.items()}


def image_of_tensor(image: Tensor) -> Float32:
    """Return a copy of an image (1, 3, H, W) as an array (H, W, 3)."""
    return pixels_of(ort_value_of(image, "image").numpy())
