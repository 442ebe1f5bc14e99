"""All shipped methods on the backends of the CPU that have them, and frames that all of them take."""

from typing import Any

from noise import noise
from shared_models import shared_model
from supersampler import Frame, Upscaler
from supersampler.conventions.jitter import only_ratio
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler.methods.registry import methods
from supersampler_bench.specs import with_default_gbuffers

RENDER = (17, 13)
DISPLAY = (33, 25)


def display_of(method: str) -> tuple[int, int]:
    """Return a display size that a method takes for frames of RENDER."""
    ratio = only_ratio(read_model_info(find_model(method)).ratios)
    return DISPLAY if ratio is None else (round(ratio * RENDER[0]), round(ratio * RENDER[1]))


BACKENDS = [
    (name, kind)
    for name in model_names()
    for kind in ("onnx", "cpu")
    if kind == "onnx" or methods()[name].cpu
]
"""(method, executor)."""


def make(method: str, executor: Any, **options: Any) -> Upscaler:
    fixed: dict[str, Any] = {"validate": "off", **options}
    return Upscaler(shared_model(method, executor), display_size=display_of(method), **fixed)


def frame_for(upscaler: Upscaler, index: int, **fields: Any) -> Frame:
    display = upscaler.display_size
    assert display is not None
    return with_default_gbuffers(noise(index, RENDER, **fields), upscaler.gbuffers, display)
