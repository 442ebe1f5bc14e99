"""OSMesa, Mesa's software renderer without any display, from the libraries in the wheel lavavu-osmesa."""

import ctypes
from pathlib import Path
from typing import Any

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
        self._screen = ctypes.create_string_buffer(4 * 16 * 16)  # OSMesa requires a buffer; it stays unused
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
        while waiting:  # the libraries depend on each other: retry those that failed, until none loads
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

    def address(self, name: bytes) -> int | None:
        """Return the address of a GL function; None: there is none."""
        address: int | None = self._library.OSMesaGetProcAddress(name)
        return address

    def load(self, name: str) -> int:
        """Return the address of a GL function, 0 if there is none."""
        return self.address(name.encode()) or 0

    def __enter__(self) -> "OsMesa":
        if not self._library.OSMesaMakeCurrent(self._context, self._screen, _UNSIGNED_BYTE, 16, 16):
            raise GraphicsError("OSMesa does not make its context current")
        return self

    def __exit__(self, *_: Any) -> None:
        """Leave it current, as EGL contexts are; entering another context replaces it."""

    def release(self) -> None:
        """Free the context."""
        self._library.OSMesaDestroyContext(self._context)
