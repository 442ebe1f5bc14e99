"""`CpuLibrary`: ctypes bindings of the CPU library, sdk/native."""

import ctypes as ct
import sys
import threading
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import overlaps_itself
from supersampler.errors import INCOMPLETE_PACKAGE, LibraryError, ModelError, SupersamplerError
from supersampler.frame import Frame, Size

VERSION = 100
"""`ss_version` that this package needs."""
_NAMES = {"win32": "supersampler.dll", "darwin": "libsupersampler.dylib"}
_PATH = Path(__file__).with_name(_NAMES.get(sys.platform, "libsupersampler.so"))
_FLOAT32, _FLOAT16 = 0, 1
_BAD_MODEL, _NO_MEMORY, _CANCELLED = 3, 5, 6
_LINE = 64
"""Bytes of a cache line."""


class ErrorText(ct.Structure):
    """`ss_error`."""

    _fields_ = (("message", ct.c_char * 256),)


class Options(ct.Structure):
    """`ss_options`."""

    _fields_ = (
        ("threads", ct.c_int),
        *((name, ct.c_void_p) for name in ("parallel_for", "allocate", "release", "log", "user")),
        ("instructions", ct.c_char_p),
    )


class Image(ct.Structure):
    """`ss_image`: the pixels of an array, which the caller keeps alive."""

    _fields_ = (
        ("data", ct.c_void_p),
        ("type", ct.c_int),
        ("row_stride", ct.c_ssize_t),
        ("pixel_stride", ct.c_ssize_t),
        ("channel_stride", ct.c_ssize_t),
    )

    @classmethod
    def of(cls, array: NDArray[Any], *, planes: bool = False) -> "Image":
        """Return a view of an array (h, w) or (h, w, channels), or with `planes` of (1, channels, h, w).

        The array is float32 or float16, and no two elements share memory; see `readable`.
        """
        if planes:
            array = array[0].transpose(1, 2, 0)
        # the stride of an axis of one element is arbitrary, and 0 would mean "packed"
        rows, pixels, *channels = (
            stride if count > 1 else 1 << 20 for stride, count in zip(array.strides, array.shape, strict=True)
        )
        kind = _FLOAT16 if array.dtype == np.float16 else _FLOAT32
        data, _ = array.__array_interface__["data"]
        return cls(data, kind, rows, pixels, *(channels or [array.itemsize]))


def readable(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array if `Image.of` takes it, else a contiguous copy, float16 or float32."""
    if array.dtype in (np.float32, np.float16) and not overlaps_itself(array):
        return array
    return np.array(array, np.float16 if array.dtype == np.float16 else np.float32, order="C")


FRAME_GBUFFERS = ("base_color", "normal", "display_base_color", "display_normal", "display_depth")
"""G-buffers in `FrameData`."""


class FrameData(ct.Structure):
    """`ss_frame`."""

    _fields_ = (
        ("width", ct.c_int),
        ("height", ct.c_int),
        *((name, Image) for name in ("color", "depth", "motion", "reactive", *FRAME_GBUFFERS)),
        ("jitter", ct.c_float * 2),
        ("exposure", ct.c_float),
        ("pre_exposure", ct.c_float),
        ("reset", ct.c_int),
        ("adds_samples", ct.c_float),
    )


class Outputs(ct.Structure):
    """`ss_outputs`."""

    _fields_ = (
        *((name, Image) for name in ("image", "weight", "converged")),
        ("compute_all", ct.c_int),
        ("seconds", ct.POINTER(ct.c_double)),
        ("cancelled", ct.c_void_p),
        ("user", ct.c_void_p),
    )


class ShadedData(ct.Structure):
    """`ss_shaded`."""

    _fields_ = (
        ("width", ct.c_int),
        ("height", ct.c_int),
        *((name, Image) for name in ("color", "depth", "base_color", "normal")),
        ("jitter", ct.c_float * 2),
        ("pre_exposure", ct.c_float),
        ("motion_width", ct.c_int),
        ("motion_height", ct.c_int),
        ("motion", Image),
        ("motion_jitter", ct.c_float * 2),
    )


class ExtrapolatedOutputs(ct.Structure):
    """`ss_extrapolated`."""

    _fields_ = (("color", Image), ("motion", Image), ("cancelled", ct.c_void_p), ("user", ct.c_void_p))


class ScatterData(ct.Structure):
    """`ss_scatter`."""

    _fields_ = (
        *((name, ct.c_int) for name in ("width", "height", "next_width", "next_height")),
        *((name, ct.c_void_p) for name in ("depth", "next_depth", "next_motion")),
        ("jitter", ct.c_float * 2),
        ("next_jitter", ct.c_float * 2),
    )


class IdData(ct.Structure):
    """`ss_ids`."""

    _fields_ = (
        *((name, ct.c_int) for name in ("width", "height", "display_width", "display_height", "channels")),
        *((name, ct.c_void_p) for name in ("ids", "depth", "motion")),
        ("jitter", ct.c_float * 2),
        *((name, ct.c_void_p) for name in ("previous", "previous_distance", "image", "distance")),
    )


class AovData(ct.Structure):
    """`ss_aovs`."""

    _fields_ = (
        *((name, ct.c_int) for name in ("width", "height", "display_width", "display_height", "channels")),
        *((name, ct.c_void_p) for name in ("aovs", "depth", "motion")),
        ("jitter", ct.c_float * 2),
        *((name, ct.c_void_p) for name in ("weight", "previous", "image")),
    )


View = TypeVar("View", IdData, AovData)


def view_of(
    kind: type[View], frame: Frame, display: Size, channels: int, arrays: Mapping[str, NDArray[Any]]
) -> View:
    """Return the data of one view of `frame`, of packed arrays by name, which the caller keeps alive."""
    data = kind(*frame.size, *display, channels)
    data.jitter[:] = frame.jitter
    for name, array in arrays.items():
        setattr(data, name, array.ctypes.data)
    return data


class TemporalFrame(ct.Structure):
    """`ss_temporal_frame`."""

    _fields_ = tuple(
        (name, ct.c_void_p) for name in ("color", "noisy", "guides", "to_previous", "to_next", "aovs")
    )


class TemporalData(ct.Structure):
    """`ss_temporal`."""

    _fields_ = (
        ("width", ct.c_int),
        ("height", ct.c_int),
        ("frames", ct.POINTER(TemporalFrame)),
        ("previous", ct.c_int),
        ("following", ct.c_int),
        ("aov_groups", ct.c_int),
        ("exposure", ct.c_float),
        ("samples", ct.c_float),
        ("first_row", ct.c_int),
        ("end_row", ct.c_int),
        ("image", ct.c_void_p),
        ("aovs", ct.c_void_p),
    )


_ERROR, _HANDLE = ct.POINTER(ErrorText), ct.POINTER(ct.c_void_p)
_FUNCTIONS: Mapping[str, tuple[Any, ...]] = {  # result, then arguments
    "ss_version": (ct.c_int,),
    "ss_stage_name": (ct.c_char_p, ct.c_int),
    "ss_model_create_from_bytes": (ct.c_int, ct.c_char_p, ct.c_size_t, ct.POINTER(Options), _HANDLE, _ERROR),
    "ss_model_destroy": (None, ct.c_void_p),
    "ss_model_instructions": (ct.c_char_p, ct.c_void_p),
    "ss_required_bytes": (ct.c_int, ct.c_void_p, *[ct.c_int] * 4, *[ct.POINTER(ct.c_size_t)] * 2, _ERROR),
    "ss_history_create": (ct.c_int, ct.c_void_p, *[ct.c_int] * 4, _HANDLE, _ERROR),
    "ss_history_destroy": (None, ct.c_void_p),
    "ss_history_fits": (ct.c_int, ct.c_void_p, ct.c_int, ct.c_int),
    "ss_history_tensor": (ct.c_char_p, ct.c_void_p, ct.c_int, ct.POINTER(ct.c_int64), ct.POINTER(ct.c_int)),
    "ss_history_read": (ct.c_int, ct.c_void_p, ct.c_int, ct.c_void_p, _ERROR),
    "ss_history_write": (ct.c_int, ct.c_void_p, ct.c_int, ct.c_void_p, _ERROR),
    "ss_run_many": (
        ct.c_int, ct.c_void_p, ct.POINTER(FrameData), _HANDLE, _HANDLE, ct.POINTER(Outputs), ct.c_int, _ERROR
    ),
    "ss_run_network": (ct.c_int, ct.c_void_p, ct.c_void_p, ct.c_int, ct.c_int, ct.c_void_p, _ERROR),
    "ss_extrapolate": (
        ct.c_int, ct.c_void_p, ct.POINTER(FrameData), ct.POINTER(ShadedData), ct.POINTER(ExtrapolatedOutputs),
        _ERROR,
    ),
    "ss_camera_motion": (
        ct.c_int, ct.POINTER(Image), ct.c_int, ct.c_int, ct.c_void_p, ct.c_double, ct.c_float * 2,
        ct.POINTER(Image), _ERROR,
    ),
    "ss_encode_rgba": (ct.c_int, ct.POINTER(Image), ct.c_int, ct.c_int, ct.c_void_p, ct.c_ssize_t, _ERROR),
    "ss_merge_images": (ct.c_int, *[ct.c_void_p] * 4, ct.c_int, ct.c_int, ct.c_float, _ERROR),
    "ss_scatter_motion": (ct.c_int, ct.POINTER(ScatterData), ct.c_void_p, ct.c_void_p, _ERROR),
    "ss_resample_ids": (ct.c_int, ct.c_void_p, ct.POINTER(IdData), ct.c_int, _ERROR),
    "ss_blend_aovs": (ct.c_int, ct.c_void_p, ct.POINTER(AovData), ct.c_int, _ERROR),
    "ss_filter_temporal": (ct.c_int, ct.POINTER(TemporalData), _ERROR),
    "ss_nearest_motion": (ct.c_int, ct.c_void_p, ct.c_void_p, ct.c_int, ct.c_int, ct.c_void_p, _ERROR),
}  # fmt: skip
_Cancelled = ct.CFUNCTYPE(ct.c_int, ct.c_void_p)


class CpuLibrary:
    """The functions of the library, by name.

    Args:
        path: the shared library.

    Raises:
        LibraryError: it cannot be loaded, or is of another version.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._library = ct.CDLL(str(path))
            for name, (result, *arguments) in _FUNCTIONS.items():
                function = getattr(self._library, name)
                function.restype, function.argtypes = result, arguments
            version = self._library.ss_version()
        except (OSError, AttributeError) as error:
            hint = "`pip install .` builds it"
            if not path.exists():
                raise LibraryError(f"{path} is missing. {hint}. {INCOMPLETE_PACKAGE}") from None
            raise LibraryError(f"{path} cannot be loaded ({error}); {hint}.") from error
        if version != VERSION:
            raise LibraryError(f"{path} has the version {version}; want {VERSION}. Build it again.")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)

    def call(self, name: str, *arguments: Any) -> None:
        """Call a function, and raise the error that it reports.

        Raises:
            ModelError: the bytes of a model are damaged.
            MemoryError: there is not enough memory.
            SupersamplerError: another error; checked arguments cause none.
        """
        error = ErrorText()
        status = getattr(self._library, name)(*arguments, error)
        if status == _NO_MEMORY:
            raise MemoryError(error.message.decode())
        if status and status != _CANCELLED:
            kind = ModelError if status == _BAD_MODEL else SupersamplerError
            raise kind(error.message.decode())

    @contextmanager
    def interruptible(self, outputs: Outputs | ExtrapolatedOutputs) -> Iterator[None]:
        """Context of a call with these outputs. An exception in a signal handler (Ctrl-C) cancels the call.

        Python runs signal handlers only in the main thread.
        """
        if threading.get_ident() != threading.main_thread().ident:
            yield
            return
        raised: list[BaseException] = []
        poll = _polled(raised)
        next(poll)
        callback = _Cancelled(poll.send)
        outputs.cancelled = ct.cast(callback, ct.c_void_p)
        yield
        if raised:
            raise raised[0]


def _polled(raised: list[BaseException]) -> Generator[int, object, None]:
    """Yield 0 to the library until a signal handler raises, then 1.

    A handler runs when the generator resumes, inside `try`. In a plain function it would run at the first
    instruction, before any `try`, and ctypes drops exceptions of callbacks.
    """
    try:
        while True:
            yield 0
    except GeneratorExit:
        raise
    except BaseException as error:  # a handler may raise anything
        raised.append(error)
    while True:
        yield 1


@cache
def cpu_library() -> CpuLibrary:
    """Return the library of this package.

    Raises:
        LibraryError: it is missing or cannot be loaded.
    """
    return CpuLibrary(_PATH)


def aligned(shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return float32 zeros that start at a cache line, as the library's non-temporal stores need."""
    size = int(np.prod(shape)) * 4
    room = np.zeros(size + _LINE, np.uint8)
    first = -room.ctypes.data % _LINE
    return room[first : first + size].view(np.float32).reshape(shape)


def encode_rgba(image: NDArray[np.float32], pixels: NDArray[np.int32]) -> None:
    """Write an image (h, w, 3) to opaque pixels (h, w), bottom row first; values are clamped to [0, 1]."""
    height, width = pixels.shape
    source, row = readable(image), pixels.strides[0]
    last = pixels.ctypes.data + (height - 1) * row
    cpu_library().call("ss_encode_rgba", Image.of(source), width, height, last, -row)
