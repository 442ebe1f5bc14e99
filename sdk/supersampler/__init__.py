"""Temporal supersampling: aliased, jittered, low-resolution frames in, clean high-resolution frames out.

>>> from supersampler import Shot, Upscaler
>>> upscaler = Upscaler(scale=2)
>>> for item in Shot.open("plaza"):
...     image = upscaler.step(item.frame)  # (360, 640, 3) float32, linear RGB
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from supersampler.conventions import Conventions, RawFrame, halton_jitter, jittered_projection
from supersampler.errors import (
    ArgumentError,
    FrameError,
    ModelError,
    ShotError,
    SupersamplerError,
    did_you_mean,
)
from supersampler.frame import Frame

if TYPE_CHECKING:
    from supersampler.denoising import denoise_sequence
    from supersampler.history import State, Stats, StepResult
    from supersampler.io.shot import Shot
    from supersampler.model import Model
    from supersampler.sequence import upscale_sequence
    from supersampler.upscaler import Upscaler

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "Conventions",
    "Frame",
    "FrameError",
    "Model",
    "ModelError",
    "RawFrame",
    "Shot",
    "ShotError",
    "State",
    "Stats",
    "StepResult",
    "SupersamplerError",
    "Upscaler",
    "denoise_sequence",
    "halton_jitter",
    "jittered_projection",
    "upscale_sequence",
]

# These import ONNX Runtime or OpenImageIO, which `supersampler --help` does not need.
_LAZY = {
    "Model": "model",
    "Shot": "io.shot",
    "State": "history",
    "Stats": "history",
    "StepResult": "history",
    "Upscaler": "upscaler",
    "denoise_sequence": "denoising",
    "upscale_sequence": "sequence",
}
_SUBMODULES = (
    "conventions",
    "errors",
    "history",
    "io.display",
    "io.shot",
    "methods.model_file",
    "validation",
)
"""Modules with public names that are not exported here."""


def __getattr__(name: str) -> Any:
    """Import heavy modules on first use; the error for a name of another module names that module."""
    if name in _LAZY:
        value = getattr(import_module(f"supersampler.{_LAZY[name]}"), name)
        globals()[name] = value
        return value
    problem = f"module 'supersampler' has no attribute {name!r}"
    if not name.startswith("_"):  # tools look up such names in every module
        for module in (import_module(f"supersampler.{submodule}") for submodule in _SUBMODULES):
            if name in _public(module):
                raise AttributeError(f"{problem}. It is in {module.__name__}")
        problem = f"{problem}. {did_you_mean(name, __all__)}".rstrip(". ")
    raise AttributeError(problem)


def _public(module: Any) -> list[str]:
    if hasattr(module, "__all__"):
        return list(module.__all__)
    return [n for n, value in vars(module).items() if getattr(value, "__module__", "") == module.__name__]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
