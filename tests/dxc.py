"""Microsoft's HLSL compiler from its shared library, by ctypes.

Its COM objects have, outside of Windows, two entries for the destructor after the three of IUnknown.
"""

import ctypes
from pathlib import Path
from uuid import UUID

COMPILER, COMPILER3, RESULT = (
    UUID(text).bytes_le
    for text in (
        "73e22d93-e6ce-47f3-b5bf-f0664f39c1b0",  # CLSID_DxcCompiler
        "228b4687-5a6a-4730-900c-9702b2203f54",  # IDxcCompiler3
        "58346cda-dde7-4497-9461-6f87af5e0659",  # IDxcResult
    )
)
UTF8 = 65001
_COMPILE, _STATUS, _OBJECT, _ERRORS = 5, 5, 6, 7  # of IDxcCompiler3; of IDxcResult
_POINTER, _SIZE = 5, 6  # of IDxcBlob


class _Buffer(ctypes.Structure):
    _fields_ = (("data", ctypes.c_char_p), ("size", ctypes.c_size_t), ("encoding", ctypes.c_uint))


def _call(thing: ctypes.c_void_p, entry: int, *given: object, returns: object = ctypes.c_int32) -> object:
    table = ctypes.cast(thing, ctypes.POINTER(ctypes.POINTER(ctypes.c_void_p)))[0]
    kinds = [ctypes.c_void_p, *(type(value) for value in given)]
    return ctypes.CFUNCTYPE(returns, *kinds)(table[entry])(thing, *given)  # type: ignore[arg-type]


def _blob(result: ctypes.c_void_p, entry: int) -> bytes:
    blob = ctypes.c_void_p()
    _call(result, entry, ctypes.pointer(blob))
    if not blob:
        return b""
    pointer = _call(blob, _POINTER, returns=ctypes.c_void_p)
    size = _call(blob, _SIZE, returns=ctypes.c_size_t)
    return ctypes.string_at(pointer, size) if size else b""  # type: ignore[arg-type]


def compile_hlsl(library: Path, code: bytes, entry: str, profile: str) -> tuple[bytes, str]:
    """Compile a shader.

    Args:
        library: libdxcompiler.so.
        code: HLSL.
        entry: name of the entry point.
        profile: such as "cs_6_4".

    Returns:
        The object, empty after an error; and all messages.
    """
    dxc = ctypes.CDLL(str(library))
    compiler, result = ctypes.c_void_p(), ctypes.c_void_p()
    assert dxc.DxcCreateInstance(COMPILER, COMPILER3, ctypes.byref(compiler)) == 0
    options = ["-E", entry, "-T", profile]
    arguments = (ctypes.c_wchar_p * len(options))(*options)
    source = _Buffer(code, len(code), UTF8)
    _call(
        compiler,
        _COMPILE,
        ctypes.pointer(source),
        arguments,
        ctypes.c_uint32(len(options)),
        ctypes.c_void_p(),
        ctypes.c_char_p(RESULT),
        ctypes.pointer(result),
    )
    status = ctypes.c_int32()
    _call(result, _STATUS, ctypes.pointer(status))
    errors = _blob(result, _ERRORS).rstrip(b"\0").decode("utf-8", "replace")
    return (_blob(result, _OBJECT) if status.value == 0 else b""), errors
