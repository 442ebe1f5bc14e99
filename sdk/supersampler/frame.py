"""`Frame`: the inputs of one rendered frame, with shapes, units and signs; see docs/contract.md."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import IMAGE_SIZES, as_flag, as_number, is_image_size, is_row
from supersampler.errors import ArgumentError, FrameError, did_you_mean, shown

Array: TypeAlias = NDArray[np.floating[Any]]
Float32: TypeAlias = NDArray[np.float32]
Size: TypeAlias = tuple[int, int]
"""(width, height), as in FSR, XeSS and GL; arrays are (height, width, channels), row 0 on top."""

MAX_AOVS = 1024
"""Largest number of AOV channels."""
GBUFFER_CHANNELS: Mapping[str, int] = {
    "base_color": 3, "normal": 3, "roughness": 1, "metallic": 1, "specular": 1,
}  # fmt: skip
GBUFFER_DISPLAY_CHANNELS: Mapping[str, int] = {**GBUFFER_CHANNELS, "depth": 1}

_CHANNELS = {"color": 3, "depth": 1, "motion": 2, "reactive": 1, "motion_next": 2}
_GROUPS = {"gbuffer": GBUFFER_CHANNELS, "gbuffer_display": GBUFFER_DISPLAY_CHANNELS}
_MIN_EXPOSURE = float(np.finfo(np.float32).smallest_subnormal)
_MAX_EXPOSURE = float(np.finfo(np.float32).max)
_MIN_PRE_EXPOSURE, _MAX_PRE_EXPOSURE = 2.0**-24, 2.0**24
_SINGLE = (np.dtype(np.float32),)
_HALF_OR_SINGLE = (np.dtype(np.float16), *_SINGLE)
_INTEGERS = tuple(map(np.dtype, (np.int32, np.uint32, np.int16, np.uint16, np.int8, np.uint8)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One rendered frame at render size (w, h). Row 0 is the top row; x points right, y down.

    Arrays are numpy arrays, or anything with DLPack (such as a torch tensor), which is copied to the CPU.
    Shapes and types are always checked. Pixel values are not; `Upscaler(validate=...)` checks those.

    Attributes:
        color: (h, w, 3) float32 or float16. Linear scene RGB, >= 0, before tone mapping, sampled with
            `jitter`, not anti-aliased. Values are clamped to [0, 65504]; NaN is a missing sample. None on a
            frame that was not shaded (extrapolation).
        depth: (h, w) float32. Reversed, infinite far plane: near / view distance. 0 at the sky, larger is
            closer. Only ratios are used: any constant times 1 / distance is valid if the constant stays the
            same between resets.
        motion: (h, w, 2) float32 or float16. Render pixels (x right, y down), without jitter, previous minus
            current: what is at p now was at p + motion[p] in the previous frame, shaded or not.
        jitter: (x, y) in [-0.5, 0.5], render pixels. Samples lie at pixel centre + jitter.
        reset: True on the first frame after a cut: the history is dropped.
        reactive: (h, w) float32 or float16 in [0, 1]. How unreliable the history is (particles, screens,
            glass): the weight w of this frame becomes w + (1 - w) reactive. None is 0 everywhere.
        exposure: > 0, multiplies the colour before the tone curve. None measures it from the frames.
        pre_exposure: in [2^-24, 2^24]. Factor that the renderer has applied to the colour. It may change
            from frame to frame: the history and `exposure` refer to the colour without it, and the image is
            multiplied by it again.
        gbuffer: render-size buffers by name: base_color (h, w, 3), normal (h, w, 3; world space, unit length,
            0 at the sky), roughness, metallic, specular (each (h, w); dielectric F0 = 0.08 specular).
            Linear, in [0, 1] except for the normal. If a method reads a buffer at both sizes, the render-size
            one may be missing: it is sampled from the other one, which costs quality along edges.
        gbuffer_display: display-size buffers by name, as in `gbuffer`, and `depth`, sampled at pixel centres
            without jitter.
        aovs: (h, w, k) float32 or float16, k at most MAX_AOVS. Alpha or other channels, blended with the
            colour's weights.
        ids: (h, w, k) integers of at most 32 bits, k at most MAX_AOVS. Segmentation, object, material or
            instance ids, never blended; the k values of a pixel belong together.
        motion_next: (h, w, 2) float32 or float16. Render pixels, without jitter, next minus current: what is
            at p now is at p + motion_next[p] in the next frame. Only `upscale_sequence` reads it; None is
            computed from the motion of the next frame.

    Raises:
        FrameError: an input has the wrong type, shape or range; `FrameError.name` says which.
    """

    color: Array | None
    depth: Float32
    motion: Array
    jitter: tuple[float, float]
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    reactive: Array | None = None
    gbuffer: Mapping[str, Array] | None = None
    gbuffer_display: Mapping[str, Array] | None = None
    aovs: Array | None = None
    motion_next: Array | None = None
    ids: NDArray[np.integer[Any]] | None = None

    def __post_init__(self) -> None:
        for name in (*_CHANNELS, "aovs", "ids"):
            value = getattr(self, name)
            if value is not None or name in ("depth", "motion"):
                object.__setattr__(self, name, as_array(name, value))
        for name in _GROUPS:
            buffers = getattr(self, name)
            if buffers is not None:
                known = checked_buffers(name, buffers).items()
                arrays = {key: as_array(f"{name}[{key!r}]", value) for key, value in known}
                object.__setattr__(self, name, arrays)
        self.check_shapes()
        if self.reactive is not None:
            _check_reactive(self.reactive)
        object.__setattr__(self, "jitter", checked_jitter(self.jitter))
        object.__setattr__(self, "exposure", checked_exposure(self.exposure))
        object.__setattr__(self, "pre_exposure", checked_pre_exposure(self.pre_exposure))
        object.__setattr__(self, "reset", checked_reset(self.reset))

    @property
    def size(self) -> Size:
        """Render size (width, height)."""
        height, width = self.depth.shape
        return width, height

    def check_shapes(self) -> None:
        """Raise FrameError unless the arrays have the shapes and types above.

        Steps check again, because the caller may have set another shape, type or G-buffer meanwhile.
        """
        leader = self.depth if self.color is None else self.color  # the other arrays must match its size
        if leader.ndim < 2 or 0 in leader.shape:
            name, want = ("depth", "(h, w)") if self.color is None else ("color", "(h, w, 3)")
            raise FrameError(name, got=leader.shape, want=f"{want} with at least one pixel")
        h, w = leader.shape[1:] if _is_channels_first(leader) else leader.shape[:2]
        for name, channels in _CHANNELS.items():
            array = getattr(self, name)
            if array is not None:
                shape = (h, w) if channels == 1 else (h, w, channels)
                _check(name, array, shape, _SINGLE if name == "depth" else _HALF_OR_SINGLE)
        for name in ("aovs", "ids"):
            array = getattr(self, name)
            if array is not None:
                count = array.shape[-1] if array.shape[:2] == (h, w) and array.ndim == 3 else 0
                wanted = (h, w, count if 1 <= count <= MAX_AOVS else "k")
                _check(name, array, wanted, _INTEGERS if name == "ids" else _HALF_OR_SINGLE)
        _check_gbuffers("gbuffer", self.gbuffer, (w, h))
        _check_gbuffers("gbuffer_display", self.gbuffer_display, None)


def checked_frame(frame: Frame) -> Frame:
    """Return a frame after `Frame.check_shapes`; raise ArgumentError if it is not a Frame."""
    if not isinstance(frame, Frame):
        raise ArgumentError("frame", got=shown(frame), want="a supersampler.Frame", hint=_frame_hint(frame))
    frame.check_shapes()
    return frame


def _frame_hint(value: object) -> str:
    """Return advice for values that are often passed instead of a Frame."""
    if isinstance(getattr(value, "frame", None), Frame):
        return f"Pass the `frame` of the {type(value).__name__}."
    if isinstance(value, list | tuple):
        return "Pass one frame per call, in order."
    if hasattr(value, "shape"):
        return "Frame(color=, depth=, motion=, jitter=) takes the arrays."
    return "`Conventions.converter` converts a RawFrame."


def checked_jitter(jitter: Sequence[float]) -> tuple[float, float]:
    """Return a frame's jitter as two floats; raise FrameError unless both are in [-0.5, 0.5]."""
    x, y = pair_of(jitter)
    if not max(abs(x), abs(y)) <= 0.5:  # written so that NaN fails
        hint = "Jitter in NDC is 2/w and 2/h times the pixel offset; in UV 1/w and 1/h."
        raise FrameError("jitter", got=(x, y), want="render pixels in [-0.5, 0.5]", hint=hint)
    return x, y


def pair_of(jitter: Sequence[float]) -> tuple[float, float]:
    """Return a jitter in any unit as two floats; raise FrameError if it is not a pair of numbers."""
    pair = [as_number(value) for value in jitter] if is_row(jitter) else []
    if len(pair) != 2 or pair[0] is None or pair[1] is None:
        raise FrameError("jitter", got=shown(jitter), want="(x, y), two numbers")
    return pair[0], pair[1]


def checked_exposure(exposure: float | None) -> float | None:
    """Return a frame's exposure; raise FrameError unless it is None or > 0 and finite in single precision."""
    if exposure is None:
        return None
    number = as_number(exposure)
    if number is None or not _MIN_EXPOSURE <= number <= _MAX_EXPOSURE:
        hint = "Single precision must hold it; None measures it from the frames."
        raise FrameError("exposure", got=shown(exposure), want="a finite number > 0, or None", hint=hint)
    return number


def checked_pre_exposure(pre_exposure: float) -> float:
    """Return a frame's pre-exposure; raise FrameError unless it is in [2^-24, 2^24]."""
    number = as_number(pre_exposure)
    if number is None or not _MIN_PRE_EXPOSURE <= number <= _MAX_PRE_EXPOSURE:
        hint = "It is the factor that the renderer has applied to the colour; 1 if none."
        want = "a number > 0, in [2^-24, 2^24]"
        raise FrameError("pre_exposure", got=shown(pre_exposure), want=want, hint=hint)
    return number


def checked_values(
    jitter: Sequence[float], exposure: float | None, pre_exposure: float
) -> tuple[tuple[float, float], float | None, float]:
    """Return jitter, exposure and pre-exposure of a frame as plain numbers; FrameError if one is invalid."""
    return checked_jitter(jitter), checked_exposure(exposure), checked_pre_exposure(pre_exposure)


def checked_reset(reset: object) -> bool:
    """Return a frame's reset flag; raise FrameError unless it is True or False."""
    flag = as_flag(reset)
    if flag is None:
        raise FrameError("reset", got=shown(reset), want="True or False")
    return flag


def as_array(
    name: str, value: object, error: type[FrameError] | type[ArgumentError] = FrameError
) -> NDArray[Any]:
    """Return `value` as an aligned numpy array, converted with DLPack if necessary.

    Args:
        name: name of the input, for the error.
        value: a numpy array, or a tensor with DLPack, which is copied if it is in device memory.
        error: type of the exception to raise.

    Raises:
        FrameError: `value` is neither, is masked, or is larger than an image may be.
    """
    array = _plain_array(name, value, error)
    if array.ndim >= 2 and array.size and not is_image_size(array.shape[1], array.shape[0]):
        raise error(name, got=f"of shape {array.shape}", want=f"width and height {IMAGE_SIZES}")
    return array if array.flags.aligned else array.copy()  # kernels need aligned values


def _plain_array(name: str, value: object, error: type[FrameError] | type[ArgumentError]) -> NDArray[Any]:
    if type(value) is np.ndarray:
        return value
    if isinstance(value, np.ma.MaskedArray):
        hint = "Fill masked values first: array.filled(0), for instance."
        raise error(name, got=f"a masked array {value.shape}", want="a numpy array without a mask", hint=hint)
    if isinstance(value, np.ndarray):
        return value.view(np.ndarray)  # without the behaviour of subclasses such as np.matrix
    if hasattr(value, "__dlpack__"):
        try:
            return np.from_dlpack(value, device="cpu")
        except Exception as problem:  # each library raises its own types
            hint = "Pass a tensor on the CPU that needs no gradient."
            got = f"{type(value).__name__} ({' '.join(str(problem).split())})"
            raise error(name, got=got, want="an array", hint=hint) from problem
    kind = None if value is None else type(value).__name__
    raise error(name, got=kind, want="a numpy array, or anything with DLPack")


def _check(
    name: str, array: NDArray[Any], shape: tuple[object, ...], dtypes: tuple[np.dtype[Any], ...]
) -> None:
    if array.shape == shape and array.dtype in dtypes:  # of the native byte order
        return
    wanted = " or ".join(dtype.name for dtype in dtypes)
    text = "(" + ", ".join(map(str, shape)) + ")"
    raise FrameError(
        name, got=f"{array.shape} {array.dtype}", want=f"{text} {wanted}", hint=_hint(array, shape, dtypes)
    )


def _hint(array: NDArray[Any], shape: tuple[object, ...], dtypes: tuple[np.dtype[Any], ...]) -> str:
    """Return advice for the usual mistakes behind a wrong shape or type."""
    if array.shape == shape and dtypes is _INTEGERS:
        if array.dtype == np.float32:
            return "Cryptomatte's ids are bits: array.view(np.uint32). Else: array.astype(np.int32)."
        if array.dtype.kind in "iu" and (array.max() >= 2**32 or array.min() < -(2**31)):
            return "Some need more than 32 bits: give each object a smaller one, the same in every frame."
        return "Convert it: array.astype(np.int32)."
    if array.shape == shape:
        if array.dtype.kind in "iu":
            return "Scale integers to the range: array.astype(np.float32) / 255, for instance."
        return "Convert it: array.astype(np.float32)."
    if len(shape) == 3 and array.shape[1:] == shape[:2]:
        rest = "[..., :3]" if shape[2] == 3 and array.shape[0] == 4 else ""
        return f"It is channels first; pass array.transpose(1, 2, 0){rest}."
    if array.ndim == len(shape) + 1 and array.shape[0] == 1:
        return "Drop the first axis: array[0]."
    if len(array.shape) >= 2 and array.shape[:2] == (shape[1], shape[0]) and shape[0] != shape[1]:
        return "Width and height are swapped: arrays are (height, width, channels)."
    if len(shape) == 2 and array.shape == (*shape, 1):
        return "Drop the last axis: array[..., 0]."
    if len(shape) == 3 and array.ndim == 3 and array.shape[:2] == shape[:2] and isinstance(shape[2], int):
        return f"Keep the first {shape[2]} channels." if array.shape[2] > shape[2] else ""
    return f"k is 1 to {MAX_AOVS}." if shape[-1] == "k" else ""


def _is_channels_first(color: NDArray[Any]) -> bool:
    """Return whether the shape is likely (3, h, w) or (4, h, w), torch's order."""
    return color.ndim == 3 and color.shape[0] in (3, 4) and color.shape[2] > 4


def checked_buffers(name: str, buffers: Mapping[str, Array]) -> Mapping[str, Array]:
    """Return a frame's `gbuffer` or `gbuffer_display`; raise FrameError unless it maps names of G-buffers.

    The arrays are not checked.
    """
    known = _GROUPS[name]
    if not isinstance(buffers, Mapping):
        raise FrameError(name, got=shown(buffers), want="a mapping of names to arrays, or None")
    for key in buffers:
        if key not in known:
            want = f"one of {', '.join(known)}"
            hint = did_you_mean(key, known)
            raise FrameError(f"{name}[{shown(key)}]", got="not a G-buffer's name", want=want, hint=hint)
    return buffers


def _check_reactive(mask: Array) -> None:
    """Raise FrameError unless all values are in [0, 1]."""
    with np.errstate(invalid="ignore"):
        low, high = float(mask.min()), float(mask.max())
    if not (low >= 0.0 and high <= 1.0):  # written so that NaN fails
        hint = "0 keeps the history, 1 shows this frame alone: np.clip(mask, 0, 1)."
        raise FrameError("reactive", got=f"from {low:g} to {high:g}", want="values in [0, 1]", hint=hint)


def _check_gbuffers(group: str, buffers: Mapping[str, Array] | None, size: Size | None) -> None:
    """Raise FrameError unless all G-buffers are arrays of one size: `size`, (width, height), if given."""
    for key, array in checked_buffers(group, buffers or {}).items():
        name, channels = f"{group}[{key!r}]", _GROUPS[group][key]
        if not isinstance(array, np.ndarray):
            hint = "Make a new Frame, which converts it."
            raise FrameError(name, got=type(array).__name__, want="a numpy array", hint=hint)
        if size is None and array.ndim >= 2:
            size = (array.shape[1], array.shape[0])
        w, h = size or (0, 0)
        shape = (h, w) if channels == 1 else (h, w, channels)
        _check(name, array, shape, _HALF_OR_SINGLE)
