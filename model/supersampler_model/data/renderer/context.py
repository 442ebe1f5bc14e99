"""OpenGL contexts without a window: EGL (a GPU, or Mesa in software), or OSMesa from a pip wheel."""

import ctypes
import importlib.util
import sys
from collections.abc import Callable
from ctypes.util import find_library
from pathlib import Path
from typing import Any, NamedTuple

from supersampler_model.data.errors import GraphicsError

_FORMAT, _RGBA, _PROFILE, _CORE, _MAJOR, _MINOR = 0x22, 0x1908, 0x33, 0x34, 0x36, 0x37
_UNSIGNED_BYTE = 0x1401


class OsMesa:
    """An OpenGL context with the interface that moderngl expects: `load`, `release`, and `with` to use it."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        library.OSMesaGetProcAddress.restype = ctypes.c_void_p
        library.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        library.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        pointer, integer = ctypes.c_void_p, ctypes.c_int
        library.OSMesaMakeCurrent.argtypes = [pointer, pointer, ctypes.c_uint, integer, integer]
        library.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        attributes = [_FORMAT, _RGBA, _PROFILE, _CORE, _MAJOR, 4, _MINOR, 5, 0]
        self._context = library.OSMesaCreateContextAttribs(
            (ctypes.c_int * len(attributes))(*attributes), None
        )
        if not self._context:
            raise GraphicsError("OSMesa grants no core context of OpenGL 4.5")
        self._screen = ctypes.create_string_buffer(4 * 16 * 16)  # OSMesa requires a buffer; it is not used
        self.__enter__()

    @classmethod
    def from_wheel(cls, origin: str) -> "OsMesa":
        """Load the libraries beside the package whose `__init__` is `origin`."""
        folder = Path(origin).parent.parent / "lavavu_osmesa.libs"
        waiting = sorted(folder.glob("*.so*"))
        main = next((file for file in waiting if file.name.startswith("libOSMesa")), None)
        if main is None:
            raise GraphicsError(f"{folder} holds no libOSMesa")
        problem: OSError | None = None
        while waiting:  # the libraries depend on each other: retry those that failed, until none is left
            failed = []
            for file in waiting:
                try:
                    ctypes.CDLL(str(file), mode=ctypes.RTLD_GLOBAL)
                except OSError as error:
                    problem = error
                    failed.append(file)
            if main not in failed:
                break
            if len(failed) == len(waiting):
                raise GraphicsError(f"{main.name} cannot be loaded: {problem}")
            waiting = failed
        return cls(ctypes.CDLL(str(main)))

    def load(self, name: str) -> int:
        """Return the address of a GL function, or 0."""
        return self._library.OSMesaGetProcAddress(name.encode()) or 0

    def __enter__(self) -> "OsMesa":
        if not self._library.OSMesaMakeCurrent(self._context, self._screen, _UNSIGNED_BYTE, 16, 16):
            raise GraphicsError("OSMesa does not make its context current")
        return self

    def __exit__(self, *_: Any) -> None:
        """Leave the context current, as EGL contexts are; entering another context replaces it."""

    def release(self) -> None:
        """Free the context."""
        self._library.OSMesaDestroyContext(self._context)


VERSION = 450  # for glClipControl
NO_MODERNGL = 'rendering needs moderngl: pip install "supersampler[render]"'
APT = "apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri"
PIP = "pip install lavavu-osmesa"

_LOWER_LEFT, _ZERO_TO_ONE = 0x8CA1, 0x935F
_TEXTURE_2D, _DEPTH_COMPONENT, _DEPTH_COMPONENT32F, _FLOAT = 0x0DE1, 0x1902, 0x8CAC, 0x1406


class Graphics(NamedTuple):
    """A context, with GL functions that moderngl lacks."""

    gl: Any  # the moderngl context; enter it to make it current
    load: Callable[[str], int]  # returns the address of a GL function by name

    def call(self, name: str, *arguments: int | None) -> None:
        """Call a GL function of integers and null pointers that returns nothing, in the current context."""
        address = self.load(name)
        if not address:
            raise GraphicsError(f"this OpenGL has no {name}")
        types = [ctypes.c_void_p if argument is None else ctypes.c_int for argument in arguments]
        ctypes.CFUNCTYPE(None, *types)(address)(*arguments)

    def depth_texture(self, size: tuple[int, int]) -> Any:
        """Return a float depth texture, for reversed depth; moderngl's own have 24-bit integers."""
        texture = self.gl.depth_texture(size)
        self.call("glBindTexture", _TEXTURE_2D, texture.glo)
        storage = (_TEXTURE_2D, 0, _DEPTH_COMPONENT32F, *size, 0)
        self.call("glTexImage2D", *storage, _DEPTH_COMPONENT, _FLOAT, None)
        return texture


def open_graphics() -> Graphics:
    """Return a new context with depth in [0, 1]: EGL where it works, else OSMesa.

    Raises:
        GraphicsError: neither is available; the message, one line, gives the reasons and what to install.
    """
    if importlib.util.find_spec("moderngl") is None:
        raise GraphicsError(NO_MODERNGL)
    import moderngl  # an extra: supersampler[render]

    create: Any = moderngl.create_context  # typed as if every setting were a dict
    reasons = []
    for name, open_ in (("egl", _open_egl), ("osmesa", _open_osmesa)):
        try:
            loader = open_()
            graphics = Graphics(create(require=VERSION, context=loader), loader.load)
            break
        except Exception as error:  # moderngl raises bare Exceptions
            reasons.append(f"{name}: {' '.join(str(error).split())}")
    else:
        problem = f"no OpenGL {VERSION / 100:.1f} ({'; '.join(reasons)})"
        raise GraphicsError(f"{problem}. Do one of: {APT}; {PIP}")
    graphics.gl.gc_mode = "context_gc"
    with graphics.gl:
        graphics.call("glClipControl", _LOWER_LEFT, _ZERO_TO_ONE)
    return graphics


def _open_egl() -> Any:
    if find_library("EGL") is None or not sys.platform.startswith("linux"):
        raise GraphicsError("libEGL is not installed")
    from glcontext import get_backend_by_name  # moderngl's own dependency

    return get_backend_by_name("egl")(mode="standalone", glversion=VERSION)


def _open_osmesa() -> OsMesa:
    spec = importlib.util.find_spec("lavavu")  # only its libraries are used
    if spec is None or spec.origin is None:
        raise GraphicsError("the wheel lavavu-osmesa is not installed")
    return OsMesa.from_wheel(spec.origin)
