"""`NativeExecutor`: runs steps in the CPU library of sdk/native, by ctypes."""

import struct
from collections.abc import Collection, Mapping
from ctypes import (
    CDLL,
    POINTER,
    Structure,
    c_char,
    c_char_p,
    c_float,
    c_int,
    c_int64,
    c_size_t,
    c_ssize_t,
    c_void_p,
)
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import StepReport
from supersampler.errors import ArgumentError, FrameError, ModelError, SupersamplerError
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.registry import find_method
from supersampler.methods.spec import constants_of, flags_of

_FLOAT32, _FLOAT16 = 0, 1
_ERRORS: Mapping[int, type[Exception]] = {2: FrameError, 3: ModelError, 5: MemoryError}
_GBUFFERS = ("base_color", "normal", "display_base_color", "display_normal", "display_depth")


class _Error(Structure):
    _fields_ = (("message", c_char * 256),)


class _Options(Structure):
    _fields_ = (
        ("threads", c_int),
        *((name, c_void_p) for name in ("parallel_for", "allocate", "release", "log", "user")),
        ("instructions", c_char_p),
    )


class _Image(Structure):
    _fields_ = (
        ("data", c_void_p),
        ("type", c_int),
        ("row_stride", c_ssize_t),
        ("pixel_stride", c_ssize_t),
        ("channel_stride", c_ssize_t),
    )

    @classmethod
    def of(cls, array: NDArray[Any] | None) -> "_Image":
        """Return a view of (h, w) or (h, w, channels) values, of any strides. The caller keeps them alive."""
        if array is None:
            return cls()
        kind = _FLOAT16 if array.dtype == np.float16 else _FLOAT32
        # an axis of one element may have any stride, also 0, which the library takes for "packed"
        rows, pixels, channels = (
            (stride if count > 1 else 1 << 20) for stride, count in zip(*_axes(array), strict=True)
        )
        return cls(array.ctypes.data, kind, rows, pixels, channels if array.ndim > 2 else array.itemsize)


def _axes(array: NDArray[Any]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    return (*array.strides, array.itemsize)[:3], (*array.shape, 1)[:3]


class _Frame(Structure):
    _fields_ = (
        ("width", c_int),
        ("height", c_int),
        *((name, _Image) for name in ("color", "depth", "motion", "reactive", *_GBUFFERS)),
        ("jitter", c_float * 2),
        ("exposure", c_float),
        ("pre_exposure", c_float),
        ("reset", c_int),
        ("adds_samples", c_float),
    )


class _Outputs(Structure):
    _fields_ = (("image", _Image), ("weight", _Image), ("converged", _Image), ("compute_all", c_int))


class NativeLibrary:
    """The functions of the library.

    Args:
        path: of the shared library.
    """

    def __init__(self, path: Path) -> None:
        self._library = CDLL(str(path))
        error, pointer = POINTER(_Error), POINTER(c_void_p)
        signatures: Mapping[str, tuple[Any, ...]] = {
            "ss_model_create": (c_int, c_char_p, POINTER(_Options), pointer, error),
            "ss_model_create_from_bytes": (c_int, c_void_p, c_size_t, POINTER(_Options), pointer, error),
            "ss_model_destroy": (None, c_void_p),
            "ss_model_instructions": (c_char_p, c_void_p),
            "ss_history_create": (c_int, c_void_p, c_int, c_int, c_int, c_int, pointer, error),
            "ss_history_destroy": (None, c_void_p),
            "ss_history_fits": (c_int, c_void_p, c_int, c_int),
            "ss_history_bytes": (c_size_t, c_void_p),
            "ss_history_tensor": (c_char_p, c_void_p, c_int, POINTER(c_int64)),
            "ss_history_read": (c_int, c_void_p, c_int, c_void_p, error),
            "ss_history_write": (c_int, c_void_p, c_int, c_void_p, error),
            "ss_run": (c_int, c_void_p, POINTER(_Frame), c_void_p, c_void_p, POINTER(_Outputs), error),
        }
        for name, (result, *arguments) in signatures.items():
            function = getattr(self._library, name)
            function.restype, function.argtypes = result, arguments

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)

    def check(self, name: str, *arguments: Any) -> None:
        """Call a function, and raise what it reports."""
        error = _Error()
        status = getattr(self._library, name)(*arguments, error)
        if status:
            message = error.message.decode()
            kind = _ERRORS.get(status, SupersamplerError)
            if issubclass(kind, (FrameError, ArgumentError)):
                raise kind("frame", got=message, want="a frame of the contract")
            raise kind(message)


class Tensor(NamedTuple):
    """A history tensor: its place in the list of the library, and its shape."""

    place: int
    shape: tuple[int, ...]


class NativeHistory:
    """A history of the library; see `Executor`."""

    def __init__(self, library: NativeLibrary, model: c_void_p, display: Size, render: Size) -> None:
        self.library, self.display, self.handle = library, display, c_void_p()
        library.check("ss_history_create", model, *display, *render, self.handle)

    def __del__(self) -> None:
        self.library.ss_history_destroy(self.handle)

    def tensors(self) -> dict[str, Tensor]:
        """Return its tensors by name."""
        found: dict[str, Tensor] = {}
        shape = (c_int64 * 4)()
        while name := self.library.ss_history_tensor(self.handle, len(found), shape):
            found[name.decode()] = Tensor(len(found), tuple(shape))
        return found


class NativeExecutor:
    """Runs steps of one model in the library; see `Executor`.

    Args:
        library: the library.
        model: name of a method, or the bytes of a model.
        threads: number of threads; 0: one for each core.
        instructions: "" for the best that this CPU has, or those to use.
    """

    name = "cpu"
    precision = "fp32"

    def __init__(
        self, library: NativeLibrary, model: str | bytes, threads: int = 0, instructions: str = ""
    ) -> None:
        self._library, self._model = library, c_void_p()
        options = _Options(threads=threads, instructions=instructions.encode() or None)
        if isinstance(model, str):
            library.check("ss_model_create", model.encode(), options, self._model)
        else:
            library.check("ss_model_create_from_bytes", model, len(model), options, self._model)

    def __del__(self) -> None:
        self._library.ss_model_destroy(self._model)

    @property
    def instructions(self) -> str:
        """The instructions in use."""
        return str(self._library.ss_model_instructions(self._model).decode())

    def zeros(self, display: Size, render: Size) -> NativeHistory:
        """See `Executor`."""
        return NativeHistory(self._library, self._model, display, render)

    def fits(self, buffers: NativeHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.display == display and bool(self._library.ss_history_fits(buffers.handle, *render))

    def step(
        self,
        frame: Frame,
        display: Size,
        history: NativeHistory,
        next_history: NativeHistory,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        adds_samples: float,
        skip: bool,
    ) -> StepReport:
        """See `Executor`."""
        shape = display[::-1]
        aux = {name: np.zeros(shape, np.float32) for name in ("weight", "converged") if name in aux_outputs}
        outputs = _Outputs(_Image.of(image), *(_Image.of(aux.get(name)) for name in ("weight", "converged")))
        outputs.compute_all = not skip
        given, arrays = self._frame(frame)
        given.adds_samples = adds_samples
        self._library.check("ss_run", self._model, given, history.handle, next_history.handle, outputs)
        del arrays
        return StepReport({name: plane[None, None] for name, plane in aux.items()})

    @staticmethod
    def _frame(frame: Frame) -> tuple[_Frame, list[NDArray[Any]]]:
        """Return a frame for the library, and the arrays that must live as long."""
        given, arrays = _Frame(*frame.size), []
        images = {
            "color": frame.color,
            "depth": frame.depth,
            "motion": frame.motion,
            "reactive": frame.reactive,
        }
        buffers, of_display = frame.gbuffer or {}, frame.gbuffer_display or {}
        images |= {name: buffers.get(name) for name in ("base_color", "normal")}
        images |= {f"display_{name}": of_display.get(name) for name in ("base_color", "normal", "depth")}
        for name, array in images.items():
            if array is not None:
                kept = array if array.dtype in (np.float32, np.float16) else array.astype(np.float32)
                arrays.append(kept)
                setattr(given, name, _Image.of(kept))
        given.jitter[:] = frame.jitter
        given.exposure, given.pre_exposure = frame.exposure or 0.0, frame.pre_exposure
        return given, arrays

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        return int(self._library.ss_history_bytes(self.zeros(display, render).handle)), None

    def tensor(self, buffers: NativeHistory, name: str) -> Float32:
        """See `Executor`."""
        tensor = buffers.tensors()[name.removeprefix("history.")]
        values = np.zeros(tensor.shape, np.float32)
        self._library.check("ss_history_read", buffers.handle, tensor.place, values.ctypes.data)
        return values

    def load(self, buffers: NativeHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        for name, tensor in buffers.tensors().items():
            values = np.ascontiguousarray(tensors[f"history.{name}"], np.float32)
            if values.size != np.prod(tensor.shape):
                raise ValueError(f"{name} has the shape {values.shape}; want {tensor.shape}")
            self._library.check("ss_history_write", buffers.handle, tensor.place, values.ctypes.data)


_MAGIC = b"ssarray1"
_TYPES = {"float32": 0, "int8": 1, "uint8": 2}


def model_bytes(info: ModelInfo) -> bytes:
    """Return the file of a model for the library: its method, constants and weights (see src/arrays.h).

    Raises:
        ModelError: network.npz is damaged, or does not match the model's config.
    """
    spec = find_method(info.method)
    assert spec is not None  # noqa: S101 - shipped or exported
    arrays: dict[str, NDArray[Any]] = {"method": np.frombuffer(info.method.encode() + b"\0", np.uint8)}
    arrays |= {
        name: np.array([info.config[name]], np.float32) for name in (*constants_of(spec), *flags_of(spec))
    }
    if "network.npz" in spec.kernel_files:
        from supersampler.methods.classifier.network_file import read_network
        from supersampler.methods.classifier.structs import Variant

        arrays |= read_network(info, Variant.of(info.config).outputs)
    return arrays_bytes(arrays)


def arrays_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """Return named arrays in the format of src/arrays.h. Other types than its own become float32."""
    parts = [_MAGIC]
    for name, given in arrays.items():
        array = np.ascontiguousarray(given if str(given.dtype) in _TYPES else given.astype(np.float32))
        shape = (*array.shape, 1, 1, 1)[:4]
        parts.append(struct.pack("<48s8I", name.encode(), _TYPES[str(array.dtype)], array.ndim, *shape, 0, 0))
        parts.append(array.tobytes() + bytes(-array.nbytes % 8))
    body = b"".join(parts)
    return body + struct.pack("<Q", _checksum(body))


def _checksum(data: bytes) -> int:
    """Return FNV-1a of 64 bits."""
    total = 0xCBF29CE484222325
    for byte in data:
        total = (total ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return total
