"""ONNX Runtime without telemetry, and its execution providers. All modules import `ort` from here.

ONNX Runtime is imported on first use, because the CPU and GPU backends do not need it.

Since 1.29, official builds for Linux and macOS write a device id and a database to the user's cache during
the import, and later send names and hashes of models to Microsoft. The variable `ORT_DISABLE_TELEMETRY`
prevents this. It is only read during the import, so it is set for the import and then removed.
`disable_telemetry_events` covers Windows, and programs that have already imported onnxruntime. If the user
has set the variable, to any value, nothing is changed.
"""

import atexit
import ctypes
import os
import time
import weakref
from _thread import get_ident
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from threading import Event
from types import ModuleType, TracebackType
from typing import TYPE_CHECKING, Any

from supersampler.arguments import is_row
from supersampler.errors import ArgumentError, ProviderError, did_you_mean, shown

_VARIABLE = "ORT_DISABLE_TELEMETRY"


@cache
def _onnx_runtime() -> ModuleType:
    if _VARIABLE in os.environ:
        import onnxruntime
    else:
        os.environ[_VARIABLE] = "1"
        try:
            import onnxruntime
        finally:
            os.environ.pop(_VARIABLE, None)
        onnxruntime.disable_telemetry_events()
    atexit.register(_wait_for_runs)  # after the import, so that it runs before ONNX Runtime's handlers
    module: ModuleType = onnxruntime
    return module


class _OnUse:
    """ONNX Runtime, imported at its first attribute."""

    def __getattr__(self, name: str) -> Any:
        return getattr(_onnx_runtime(), name)


if TYPE_CHECKING:
    import onnxruntime as ort
else:
    ort = _OnUse()

__all__ = ["CPU", "NAMES", "OnnxRun", "device_of", "keep_in_forks", "ort", "precise", "resolve_providers"]

_MAX_SECONDS = 30.0  # that the interpreter waits for runs
_running: set[int] = set()  # threads in a run
_ending: list[int] = []
"""The thread that ends the interpreter, once it does."""


class OnnxRun:
    """Context of a run, or of loading a graph: `with OnnxRun(): session.run(...)`.

    The interpreter waits at its end for those in daemon threads, and no more start in these: the end of a
    thread in ONNX Runtime, or unloading it, aborts the process. Other exit handlers may still run graphs.
    """

    def __enter__(self) -> None:
        _running.add(get_ident())
        if _ending and _ending[0] != get_ident():
            _running.discard(get_ident())
            Event().wait()  # forever, as this is a daemon thread of a process that ends

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _running.discard(get_ident())


def _wait_for_runs() -> None:
    _ending.append(get_ident())
    latest = time.monotonic() + _MAX_SECONDS
    while _running - {get_ident()} and time.monotonic() < latest:
        time.sleep(0.002)


_sessions: "weakref.WeakSet[ort.InferenceSession]" = weakref.WeakSet()


def keep_in_forks(session: "ort.InferenceSession") -> None:
    """Never free a session in forked children: ONNX Runtime waits for its threads, which a child lacks."""
    _sessions.add(session)


def _after_fork() -> None:
    _running.clear()
    for session in list(_sessions):
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(session))  # a list would be freed at the child's end


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


NAMES = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "directml": "DmlExecutionProvider",
    "rocm": "ROCMExecutionProvider",
    "migraphx": "MIGraphXExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
    "webgpu": "WebGpuExecutionProvider",
}
"""ONNX Runtime's name of each provider, by its short name. Both are accepted."""
CPU = NAMES["cpu"]

_AUTOMATIC = ("cuda", "directml", "cpu")  # providers that support every operator of our graphs
_PRECISE = {NAMES["cuda"]: {"use_tf32": "0"}}
"""Options for full float32 products: TF32 has 10 bits, too few for the moments of colours."""
_DEVICES = {NAMES["cuda"]: "cuda", NAMES["tensorrt"]: "cuda", NAMES["directml"]: "dml"}
_DISTRIBUTIONS = ("onnxruntime", *(f"onnxruntime-{kind}" for kind in ("gpu", "directml", "rocm", "openvino")))


def resolve_providers(providers: str | Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names for `providers`: "auto", one name, or several in order of preference.

    Raises:
        ArgumentError: `providers` is neither a name nor a list of names.
        ProviderError: a name is unknown, or its provider is not installed; the message lists those that are.
    """
    given = [providers] if isinstance(providers, str) else providers
    if not is_row(given) or not all(isinstance(name, str) for name in given) or not len(given):
        want = "'auto', a provider's name, or several in a list"
        raise ArgumentError("providers", got=shown(providers), want=want)
    is_plain = _distribution() == "onnxruntime" or find_spec("onnxruntime") is None
    if is_plain and isinstance(providers, str) and providers in ("auto", "cpu"):
        return [CPU]  # the only one of _AUTOMATIC in that distribution; the CPU and GPU backends need none
    available = ort.get_available_providers()
    if isinstance(providers, str) and providers == "auto":
        return [NAMES[name] for name in _AUTOMATIC if NAMES[name] in available][:1]
    names = [NAMES.get(name.lower(), name) for name in given]
    for typed, name in zip(given, names, strict=True):
        if name not in (*NAMES.values(), *available, *ort.get_all_providers()):
            raise ProviderError(
                f"no execution provider is called {shown(typed)}; known are {', '.join(NAMES)}, ONNX "
                f"Runtime's own names, and 'auto' by itself. Available here: {', '.join(available)}. "
                f"{did_you_mean(typed, NAMES)}".rstrip()
            )
        if name not in available:
            raise ProviderError(
                f"execution provider {typed!r} is not in this installation of ONNX Runtime; "
                f"available: {', '.join(available)}. Other providers come with other distributions: "
                "uninstall onnxruntime, then install onnxruntime-gpu or onnxruntime-directml."
            )
    return list(dict.fromkeys(names))


def device_of(provider: str) -> str:
    """Return the device of a provider's tensors, as ONNX Runtime names it: "cpu", "cuda", "dml"."""
    return _DEVICES.get(provider, "cpu")


def precise(providers: Sequence[str]) -> list[str | tuple[str, dict[str, str]]]:
    """Return providers, with options that switch TF32 off where it is on by default."""
    return [(name, _PRECISE[name]) if name in _PRECISE else name for name in providers]


def _distribution() -> str | None:
    """Return the installed distribution of ONNX Runtime, if it is a known one.

    Raises:
        ProviderError: there are two, which overwrite each other's files.
    """
    from importlib import metadata  # takes 10 ms; the CPU backend need not wait

    found = [name for name in _DISTRIBUTIONS if any(metadata.distributions(name=name))]
    if len(found) > 1:
        raise ProviderError(
            f"{' and '.join(found)} are installed at once and overwrite each other's files. "
            f"Uninstall all of them (pip uninstall {' '.join(found)}), then install the one you want."
        )
    return found[0] if found else None
