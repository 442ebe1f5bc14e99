"""Execution providers of ONNX Runtime, requested by name. A provider that cannot run is an error."""

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
"""Short names; ONNX Runtime's own names are accepted, too."""
CPU = NAMES["cpu"]

_AUTOMATIC = ("cuda", "directml", "cpu")  # providers that support every operator of our graphs
_CAPTURE = {  # options that capture a session as a CUDA graph; on the CPU there is nothing to capture
    NAMES["cuda"]: {"enable_cuda_graph": "1"},
    NAMES["tensorrt"]: {"trt_cuda_graph_enable": "1"},
    CPU: {},
}
_PRECISE = {NAMES["cuda"]: {"use_tf32": "0"}}
"""Options of full float32 products: TF32 has 10 bits, too few for the moments of colours."""
_DEVICES = {NAMES["cuda"]: "cuda", NAMES["tensorrt"]: "cuda", NAMES["directml"]: "dml"}
_DISTRIBUTIONS = ("onnxruntime", *(f"onnxruntime-{kind}" for kind in ("gpu", "directml", "rocm", "openvino")))


def resolve_providers(providers: str | Sequence[str]) -> list[str]:
    """Return ONNX Runtime's names for `providers`: "auto", one name, or several in order of preference.

    Raises:
        ArgumentError: `providers` is neither a name nor a list of names.
        ProviderError: a name is unknown, or its provider is not installed; the message lists those that are.
    """
    wanted = [providers] if isinstance(providers, str) else providers
    if not is_row(wanted) or not all(isinstance(name, str) for name in wanted) or not len(wanted):
        want = "'auto', a provider's name, or several in a list"
        raise ArgumentError("providers", got=shown(providers), want=want)
    _check_one_distribution()
    available = ort.get_available_providers()
    if isinstance(providers, str) and providers == "auto":
        return [NAMES[name] for name in _AUTOMATIC if NAMES[name] in available][:1]
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
    """Return the device of a provider's tensors, as ONNX Runtime names it: "cpu", "cuda", "dml"."""
    return _DEVICES.get(provider, "cpu")


def capturing(providers: Sequence[str]) -> list[tuple[str, dict[str, str]]]:
    """Return providers with options, of which the first captures the runs of a session.

    Raises:
        ProviderError: the first provider cannot capture.
    """
    if providers[0] not in _CAPTURE:
        raise ProviderError(
            f"{providers[0]} cannot capture a step; {', '.join(_CAPTURE)} take capture=True. "
            "Leave it out, or ask for one of these."
        )
    return [(name, _CAPTURE[name] if name == providers[0] else {}) for name in providers]


def precise(
    providers: Sequence[str | tuple[str, dict[str, str]]],
) -> list[str | tuple[str, dict[str, str]]]:
    """Return providers with the options that switch off TF32, where a provider has it on by default."""
    named = [(given, {}) if isinstance(given, str) else given for given in providers]
    merged = [(name, {**_PRECISE.get(name, {}), **options}) for name, options in named]
    return [(name, options) if options else name for name, options in merged]


def check_provider_in_use(wanted: str, used: Sequence[str]) -> None:
    """Raise ProviderError if ONNX Runtime uses another provider, as it does when libraries are missing."""
    if wanted not in used:
        raise ProviderError(
            f"{wanted} is installed but could not start; ONNX Runtime fell back to {', '.join(used)}. "
            "Its libraries (CUDA and cuDNN for CUDAExecutionProvider) are missing or of another version."
        )


def _check_one_distribution() -> None:
    """Raise ProviderError if two distributions of ONNX Runtime overwrite each other's files."""
    found = [name for name in _DISTRIBUTIONS if any(metadata.distributions(name=name))]
    if len(found) > 1:
        raise ProviderError(
            f"{' and '.join(found)} are installed at once and overwrite each other's files. "
            f"Uninstall all of them (pip uninstall {' '.join(found)}), then install the one you want."
        )
