"""OpenGL contexts without a window: EGL (a GPU, or Mesa in software), else OSMesa from a pip wheel."""

import ctypes
import importlib.util
import sys
from collections.abc import Callable
from ctypes.util import find_library
from typing import Any, Literal, NamedTuple

from supersampler_model.data.errors import GraphicsError
from supersampler_model.data.renderer.osmesa import OsMesa

VERSION = 450  # for glClipControl
NO_MODERNGL = 'rendering needs moderngl: pip install "supersampler[render]"'
APT = "apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri"
PIP = "pip install lavavu-osmesa"

_LOWER_LEFT, _ZERO_TO_ONE = 0x8CA1, 0x935F
_TEXTURE_2D, _DEPTH_COMPONENT, _DEPTH_COMPONENT32F, _FLOAT = 0x0DE1, 0x1902, 0x8CAC, 0x1406

Backend = Literal["auto", "egl", "osmesa"]


class Graphics(NamedTuple):
    """A context, with GL functions that moderngl lacks.

    Attributes:
        gl: the moderngl context; enter it to make it current.
        address: returns the address of a GL function by name.
    """

    gl: Any
    address: Callable[[bytes], int | None]

    def call(self, name: str, *arguments: int | None) -> None:
        """Call a GL function of integers and null pointers that returns nothing, in the current context."""
        address = self.address(name.encode())
        if not address:
            raise GraphicsError(f"this OpenGL has no {name}")
        types = [ctypes.c_void_p if argument is None else ctypes.c_int for argument in arguments]
        ctypes.CFUNCTYPE(None, *types)(address)(*arguments)

    def depth_texture(self, size: tuple[int, int]) -> Any:
        """Return a depth texture of floats, which reversed depth needs; moderngl's has 24-bit integers."""
        texture = self.gl.depth_texture(size)
        self.call("glBindTexture", _TEXTURE_2D, texture.glo)
        storage = (_TEXTURE_2D, 0, _DEPTH_COMPONENT32F, *size, 0)
        self.call("glTexImage2D", *storage, _DEPTH_COMPONENT, _FLOAT, None)
        return texture


def open_graphics(backend: Backend = "auto") -> Graphics:
    """Return a new context with depth in [0, 1]; "auto" takes EGL where it works, else OSMesa.

    Raises:
        GraphicsError: neither is available; the message, one line, gives the reason and what to install.
    """
    if importlib.util.find_spec("moderngl") is None:
        raise GraphicsError(NO_MODERNGL)
    openers = {"egl": _open_egl, "osmesa": _open_osmesa}
    reasons = []
    for name in openers if backend == "auto" else (backend,):
        try:
            graphics = openers[name]()
            break
        except Exception as error:  # moderngl raises bare Exceptions
            reasons.append(f"{name}: {' '.join(str(error).split())}")
    else:
        wanted = f"no OpenGL {VERSION / 100:.1f} ({'; '.join(reasons)})"
        raise GraphicsError(f"{wanted}. Do one of: {APT}; {PIP}")
    graphics.gl.gc_mode = "context_gc"
    with graphics.gl:
        graphics.call("glClipControl", _LOWER_LEFT, _ZERO_TO_ONE)
    return graphics


def _open_egl() -> Graphics:
    library = find_library("EGL")
    if library is None or not sys.platform.startswith("linux"):
        raise GraphicsError("libEGL is not installed")
    gl = _create_context(backend="egl")
    egl = ctypes.CDLL(library)
    egl.eglGetProcAddress.restype = ctypes.c_void_p
    egl.eglGetProcAddress.argtypes = [ctypes.c_char_p]
    return Graphics(gl, egl.eglGetProcAddress)


def _open_osmesa() -> Graphics:
    spec = importlib.util.find_spec("lavavu")  # its libraries are all we take from it
    if spec is None or spec.origin is None:
        raise GraphicsError("the wheel lavavu-osmesa is not installed")
    loader = OsMesa.from_wheel(spec.origin)
    return Graphics(_create_context(context=loader), loader.address)


def _create_context(**settings: Any) -> Any:
    import moderngl  # an extra: supersampler[render]

    create: Any = moderngl.create_context  # typed as if every setting were a dict
    return create(require=VERSION, standalone=True, **settings)
