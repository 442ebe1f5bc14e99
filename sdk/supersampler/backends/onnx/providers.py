"""Which ONNX Runtime execution provider runs a graph; asked for by name, never replaced in silence."""

from collections.abc import Sequence
from importlib import metadata

from supersampler.arguments import is_row
from supersampler.backends.onnx.runtime import ort
from supersampler.errors import ArgumentError, ProviderError, did_you_mean, shown

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
"""Short names; ONNX Runtime's own are taken too."""

CPU = NAMES["cpu"]

AUTOMATIC = ("cuda", "directml", "cpu")
"""What "auto" looks for, in this order: the providers that run every operator of our graphs at once."""

_CAPTURE = {
    NAMES["cuda"]: {"enable_cuda_graph": "1"},
    NAMES["tensorrt"]: {"trt_cuda_graph_enable": "1"},
    CPU: {},  # has no launches to save: to try all but the capture itself
}

_DEVICES = {NAMES["cuda"]: "cuda", NAMES["tensorrt"]: "cuda", NAMES["directml"]: "dml"}

_DISTRIBUTIONS = (
    "onnxruntime",
    "onnxruntime-gpu",
    "onnxruntime-directml",
    "onnxruntime-rocm",
    "onnxruntime-openvino",
)


def resolve_providers(providers: str | Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names for `providers`: "auto", one name, or several in order of preference.

    Raises:
        ArgumentError: it is neither a name nor a list of some.
        ProviderError: no provider has one of the names, or it is not in this installation; lists those that
            there are.
    """
    wanted = [providers] if isinstance(providers, str) else providers
    if not is_row(wanted) or not all(isinstance(name, str) for name in wanted) or not len(wanted):
        want = "'auto', a provider's name, or several in a list"
        raise ArgumentError("providers", got=shown(providers), want=want)
    check_one_distribution()
    available = ort.get_available_providers()
    if isinstance(providers, str) and providers == "auto":
        return [NAMES[name] for name in AUTOMATIC if NAMES[name] in available][:1]
    names = [NAMES.get(name.lower(), name) for name in wanted]
    for asked, name in zip(wanted, names, strict=True):
        if name not in (*NAMES.values(), *available, *ort.get_all_providers()):
            raise ProviderError(
                f"no execution provider is called {shown(asked)}; known are {', '.join(NAMES)}, ONNX "
                f"Runtime's own names, and 'auto' by itself. Available here: {', '.join(available)}. "
                f"{did_you_mean(asked, NAMES)}".rstrip()
            )
        if name not in available:
            raise ProviderError(
                f"execution provider {asked!r} is not in this installation of ONNX Runtime; "
                f"available: {', '.join(available)}. Other providers come with other distributions: "
                "uninstall onnxruntime, then install onnxruntime-gpu or onnxruntime-directml."
            )
    return list(dict.fromkeys(names))


def device_of(provider: str) -> str:
    """Where tensors of a provider lie, as ONNX Runtime calls it: "cpu", "cuda", "dml"."""
    return _DEVICES.get(provider, "cpu")


def capturing(providers: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Return these providers, each with options: the first is to capture what a session runs.

    Raises:
        ProviderError: it cannot.
    """
    if providers[0] not in _CAPTURE:
        raise ProviderError(
            f"{providers[0]} cannot capture a step; {', '.join(_CAPTURE)} take capture=True. "
            "Leave it out, or ask for one of these."
        )
    return [(name, _CAPTURE[name] if name == providers[0] else {}) for name in providers]


def check_provider_in_use(wanted: str, used: Sequence[str]) -> None:
    """Raise ProviderError if ONNX Runtime fell back to another provider, as it does when libraries lack."""
    if wanted not in used:
        raise ProviderError(
            f"{wanted} is installed but could not start; ONNX Runtime fell back to {', '.join(used)}. "
            "Its libraries (CUDA and cuDNN for CUDAExecutionProvider) are missing or of another version."
        )


def check_one_distribution() -> None:
    """Raise ProviderError if two distributions of ONNX Runtime overwrite each other's files."""
    found = []
    for name in _DISTRIBUTIONS:
        try:
            metadata.distribution(name)
        except metadata.PackageNotFoundError:
            continue
        found.append(name)
    if len(found) > 1:
        raise ProviderError(
            f"{' and '.join(found)} are installed at once and overwrite each other's files. "
            f"Uninstall all of them (pip uninstall {' '.join(found)}), then install the one you want."
        )
