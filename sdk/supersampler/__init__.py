"""Temporal supersampling: aliased, jittered, low-resolution frames in, clean high-resolution frames out.

>>> from supersampler import Upscaler, shipped_shot
>>> upscaler = Upscaler(scale=2)
>>> for item in shipped_shot():
...     image = upscaler.step(item.frame)  # (360, 640, 3) float32, linear RGB
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from supersampler.conventions import Conventions, Converter, RawFrame
from supersampler.conventions.jitter import (
    halton_jitter,
    jitter_phase_count,
    jittered_projection,
    mip_bias,
    render_size_for,
)
from supersampler.errors import (
    ArgumentError,
    BackendWarning,
    FrameError,
    FrameWarning,
    KernelError,
    ModelError,
    ProviderError,
    RecordingError,
    ShotError,
    SupersamplerError,
)
from supersampler.frame import Frame
from supersampler.io.display import auto_exposure, display_transform
from supersampler.methods.model_file import ModelInfo, model_names

if TYPE_CHECKING:
    from supersampler.history import History, Stats, StepResult
    from supersampler.io.shot import Shot, ShotFrame, ShotWriter, copy_shot, open_source, shipped_shot
    from supersampler.model import Model
    from supersampler.state import State
    from supersampler.upscaler import Upscaler
    from supersampler.validation import Detection, detect_conventions

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "BackendWarning",
    "Conventions",
    "Converter",
    "Detection",
    "Frame",
    "FrameError",
    "FrameWarning",
    "History",
    "KernelError",
    "Model",
    "ModelError",
    "ModelInfo",
    "ProviderError",
    "RawFrame",
    "RecordingError",
    "Shot",
    "ShotError",
    "ShotFrame",
    "ShotWriter",
    "State",
    "Stats",
    "StepResult",
    "SupersamplerError",
    "Upscaler",
    "auto_exposure",
    "copy_shot",
    "detect_conventions",
    "display_transform",
    "halton_jitter",
    "jitter_phase_count",
    "jittered_projection",
    "mip_bias",
    "model_names",
    "open_source",
    "render_size_for",
    "shipped_shot",
]

# These pull in ONNX Runtime or OpenImageIO, which a `supersampler --help` should not wait for.
_LAZY = {
    **dict.fromkeys(("Detection", "detect_conventions"), "validation"),
    **dict.fromkeys(("History", "Stats", "StepResult"), "history"),
    "Model": "model",
    **dict.fromkeys(
        ("Shot", "ShotFrame", "ShotWriter", "copy_shot", "open_source", "shipped_shot"), "io.shot"
    ),
    "State": "state",
    "Upscaler": "upscaler",
}


def __getattr__(name: str) -> Any:
    """Import what is heavy when it is first asked for."""
    if name not in _LAZY:
        raise AttributeError(f"module 'supersampler' has no attribute {name!r}")
    value = getattr(import_module(f"supersampler.{_LAZY[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
