"""Methods with settings as text, their compatibility with frames, and default G-buffers."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from supersampler.arguments import AtRest, ExecutorName, Precision
from supersampler.conventions.jitter import check_ratio
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.gbuffers import GBUFFERS, BufferField, grouped, lacking, listed
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.quality.masks import to_display

_TWO_PASSES = "x2"
_SUFFIXES: Mapping[str, dict[str, Any]] = {
    **{word: {"precision": word} for word in ("fp32", "fp16", "int8")},
    **{word: {"at_rest": word} for word in ("off", "accumulate")},
    "gpu": {"executor": "gpu"},
    _TWO_PASSES: {"passes": 2},
}
"""Fields of a Spec by the suffix that sets them."""


@dataclass(frozen=True)
class Spec:
    """Arguments of an `Upscaler`, and the passes of `upscale_sequence`."""

    model: str
    precision: Precision = "auto"
    at_rest: AtRest = "converge"
    executor: ExecutorName = "auto"
    passes: int = 1

    def __str__(self) -> str:
        parts = (self.model, self.precision, self.at_rest, self.executor)
        text = ":".join(part for part in parts if part not in ("auto", "converge"))
        return text if self.passes == 1 else f"{text}:{_TWO_PASSES}"


def parse_spec(text: str, *, two_passes: bool = False) -> Spec:
    """Parse a model name with suffixes: a precision, "off" or "accumulate" for `at_rest`, "gpu" or "x2".

    Suffixes follow colons. A path may contain colons, too: other text after a colon belongs to the model.

    Raises:
        ArgumentError: two suffixes set the same; or "x2" without `two_passes`, because the caller steps frame
            by frame.
    """
    model, given = text, dict[str, Any]()
    while (suffix := model.rpartition(":")[2]) in _SUFFIXES and suffix != model:
        if twice := given.keys() & _SUFFIXES[suffix]:
            want = f"one setting of its {' and '.join(twice)}"
            raise ArgumentError("method", got=shown(text), want=want)
        given |= _SUFFIXES[suffix]
        model = model.removesuffix(f":{suffix}")
    spec = Spec(model, **given)
    if spec.passes == 2 and not two_passes:
        hint = "`bench quality` measures two passes."
        raise ArgumentError("method", got=shown(text), want="a method of one pass", hint=hint)
    return spec


MATTE = {
    "base_color": (0.5, 0.5, 0.5),
    "normal": (0.0, 0.0, 1.0),
    "roughness": (0.5,),
    "metallic": (0.0,),
    "specular": (0.5,),
}
"""Values of default G-buffers: a matte surface."""


def incompatibility(model: str, render: Size, display: Size, gbuffers: Collection[str] | None = None) -> str:
    """Return why a method does not run on some frames; "" if it does.

    `gbuffers` are the names of the frames' G-buffers; with None, missing ones get default values.
    """
    info = read_model_info(find_model(model))
    if info.extrapolates:
        return f"{model} is left out: it does not upscale, it extrapolates unshaded frames."
    try:
        check_ratio(info.ratios, render, display)
    except FrameError as error:
        return f"{model} is left out: {error}"
    missing = [] if gbuffers is None else lacking(info.gbuffers, gbuffers)
    return f"{model} is left out: the frames have no {listed(missing)}." if missing else ""


def compatible(
    models: Sequence[str], render: Size, display: Size, on_left_out: Callable[[str], None]
) -> list[str]:
    """Return the methods that run at these sizes."""
    reasons = {model: incompatibility(model, render, display) for model in models}
    for reason in filter(None, reasons.values()):
        on_left_out(reason)
    return [model for model in models if not reasons[model]]


def gbuffers_of(models: Iterable[str]) -> set[str]:
    """Return the names of the G-buffers that any of these methods reads."""
    return {name for model in models for name in read_model_info(find_model(model)).gbuffers}


def with_default_gbuffers(frame: Frame, names: Iterable[str], display: Size) -> Frame:
    """Return a frame with G-buffers of these tensor names; missing ones have the values of MATTE.

    Missing depth of display size has the nearest samples of the frame's depth, and 0 where those are invalid.
    """
    found = {name: GBUFFERS[name].find(frame) for name in names}
    if all(array is not None for array in found.values()):
        return frame
    made = {
        name: _default_gbuffer(GBUFFERS[name], frame, display) if array is None else array
        for name, array in found.items()
    }
    gbuffer, gbuffer_display = grouped(made)
    return replace(frame, gbuffer=gbuffer, gbuffer_display=gbuffer_display)


def _default_gbuffer(field: BufferField, frame: Frame, display: Size) -> Float32:
    if field.key != "depth":
        return _matte(field.key, field.shape(frame.size, display))
    depth = to_display(frame.depth, frame.jitter, display)
    return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.float32(0.0))


@lru_cache(maxsize=len(GBUFFERS))  # buffers of one size; a 4K one takes 100 MB
def _matte(key: str, shape: tuple[int, ...]) -> Float32:
    return np.full((*shape[:2], len(MATTE[key])), MATTE[key], np.float32).reshape(shape)
