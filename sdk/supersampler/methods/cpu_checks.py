"""Whether CPU kernels support a model.json: its history, and the ranges of its constants."""

from importlib import import_module
from typing import Any

from supersampler.errors import ModelError
from supersampler.methods.classifier.variant import CONFIGURED
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import MethodSpec, constants_of

_SPECS = {
    "taa": ("taa", "TAA"),
    "taau": ("taau", "TAAU"),
    "classifier": ("classifier", "CLASSIFIER"),
    "classifier_large": ("classifier_large", "CLASSIFIER_LARGE"),
    "gbuffer_fast": ("gbuffer_fast", "GBUFFER_FAST"),
    "guided-warp": ("extrapolation", "GUIDED_WARP"),
}
"""Folder and name of the spec of each method with kernels; only the one in use is imported."""
_RINGS, _FARTHEST = 7, 64


def has_known_history(info: ModelInfo, kernels: str) -> bool:
    """Whether the kernels of a method, such as "taa", support a model's history and auxiliary outputs."""
    spec, shapes = _spec_of(kernels), {h.input.name: h.input.shape for h in info.history}
    return shapes == spec.graph_history and {t.name for t in info.aux_outputs} <= {*spec.aux_outputs}


def check_constants(info: ModelInfo, kernels: str) -> None:
    """Raise ModelError where a constant of model.json is not in the range that these kernels support."""
    for name, (least, most) in constants_of(_spec_of(kernels)).items():
        value: Any = info.config.get(name)
        if type(value) not in (int, float) or not least <= value <= most:
            raise wrong_constant(info, name, value, f"a number from {least:g} to {most:g}")
    for name in CONFIGURED if kernels in ("classifier", "classifier_large", "gbuffer_fast") else ():
        if type(info.config.get(name)) is not bool:
            raise wrong_constant(info, name, info.config.get(name), "true or false")


def _spec_of(kernels: str) -> MethodSpec:
    folder, name = _SPECS[kernels]
    spec: MethodSpec = getattr(import_module(f"supersampler.methods.{folder}.spec"), name)
    return spec


def are_rings(strides: object) -> bool:
    """Whether these are radii of rings of samples for `guided-warp`: pixels, from near to far."""
    return (
        isinstance(strides, list)
        and 1 <= len(strides) <= _RINGS
        and all(type(stride) is int and 1 <= stride <= _FARTHEST for stride in strides)
        and strides == sorted(strides)
    )


def wrong_constant(info: ModelInfo, name: str, value: Any, want: str) -> ModelError:
    """Return the error for a constant that is not supported."""
    return ModelError(f"{info.folder / 'model.json'}: config.{name} is {value!r:.60}; want {want}.")
