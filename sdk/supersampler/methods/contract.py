"""Check the tensors of a model.json against the graph contract (docs/contract.md)."""

from collections import Counter
from collections.abc import Iterable
from typing import NoReturn

from supersampler.errors import ModelError
from supersampler.methods.model_info import ModelInfo, TensorInfo
from supersampler.methods.spec import (
    BLOCKS,
    DISPLAY,
    HALF,
    INPUTS,
    LARGE,
    LARGE_HALF,
    PHASES,
    PREVIOUS,
    RENDER,
    WEIGHT,
    dtype_of,
)

_OF_FRAMES = {"color", "depth", "jitter", "motion", "motion_jitter", "shaded_motion"}
_MAPS = {"class_map", "weight", "count", "converged"}  # fields of StepResult


def check_contract(info: ModelInfo) -> None:
    """Raise ModelError where a tensor or map is not one of the contract."""
    for tensor in info.inputs:
        if tensor.name not in INPUTS:
            _refuse(info, "inputs", repr(tensor.name), f"any of {', '.join(INPUTS)}")
        wanted = dtype_of(tensor.name), INPUTS[tensor.name]
        if (tensor.type, tensor.shape) != wanted:
            _refuse(info, f"input {tensor.name!r}", _text(tensor), f"{wanted[1]} {wanted[0]}")
    if (info.image.type, info.image.shape) not in [("float32", (1, 3, *s)) for s in (DISPLAY, RENDER)]:
        _refuse(info, "image", _text(info.image), f"{(1, 3, *DISPLAY)} or {(1, 3, *RENDER)} float32")
    _check_unique(info, "inputs and history", info.takes)
    _check_unique(info, "image, history's outputs and aux_outputs", info.gives)
    if info.extrapolates:
        _check_extrapolation(info)
    else:
        _check_upscaling(info)
    _check_aux_outputs(info)


def check_extrapolated(outer: ModelInfo, inner: ModelInfo) -> None:
    """Raise ModelError unless the model for extrapolated frames, `inner`, has the tensors of `outer`."""
    tensors = [(m.history, m.image.shape, {t.name for t in m.aux_outputs}) for m in (outer, inner)]
    if not inner.only_extrapolated or tensors[0] != tensors[1]:
        want = f"true, with history, image and aux_outputs as in {outer.folder / 'model.json'}"
        _refuse(inner, "only_extrapolated", repr(inner.only_extrapolated), want)


def _check_upscaling(info: ModelInfo) -> None:
    if "color" not in (tensor.name for tensor in info.inputs):
        _refuse(info, "inputs", "without 'color'", "with it: the model upscales")
    known = {*RENDER, *DISPLAY, *HALF, *LARGE, *LARGE_HALF, *PREVIOUS, *BLOCKS, PHASES}
    for tensor in (h.input for h in info.history):
        if tensor.type != "float32" or not _named(tensor) <= known or tensor.name == "history.aovs":
            _refuse(info, f"history {tensor.name!r}", _text(tensor), f"float32 of {', '.join(sorted(known))}")


def _check_extrapolation(info: ModelInfo) -> None:
    """Check that each history tensor has the name of a frame's input, and `earlier_X` comes after `X`."""
    inputs = {tensor.name for tensor in info.inputs}
    if "color" in inputs or "step.onnx" not in info.files:
        got, want = "with 'color' or without 'step.onnx'", "neither: it computes the colour"
        _refuse(info, "inputs and files", got, want)
    before: set[str] = set()
    for tensor in (h.input for h in info.history):
        own = tensor.name.removeprefix("history.")
        later = own.removeprefix("earlier_")
        known = f"gbuffer_{own}" in inputs or own in _OF_FRAMES or (later != own and later in before)
        if tensor.name == own or not known or tensor.type != "float32" or tensor.shape[:1] != (1,):
            names = ", ".join(sorted(_OF_FRAMES))
            want = f"float32, 'history.' and one of {names}, a G-buffer, 'earlier_' ..."
            _refuse(info, f"history {tensor.name!r}", _text(tensor), want)
        before.add(own)


def _check_aux_outputs(info: ModelInfo) -> None:
    for tensor in info.aux_outputs:
        named = tensor.shape[2:]
        if tensor.type != "float32" or tensor.shape[:1] != (1,) or named not in (DISPLAY, HALF):
            want = f"(1, k, ...) float32 of {DISPLAY} or {HALF}"
            _refuse(info, f"aux_outputs {tensor.name!r}", _text(tensor), want)
        if tensor.name in ("weight", "converged") and tensor.shape != WEIGHT:
            _refuse(info, f"aux_outputs {tensor.name!r}", _text(tensor), f"{WEIGHT} float32")
    names = [tensor.name for tensor in info.aux_outputs]
    if info.converges and "converged" not in names:
        got, want = ", ".join(names) or "none", "'converged' too, as there is a history of the mean"
        _refuse(info, "aux_outputs", got, want)
    shapes = {h.output: h.input.shape for h in info.history} | {t.name: t.shape for t in info.aux_outputs}
    for name, where in info.maps.items():
        shape = shapes.get(where.output, ())
        channels = shape[1] if len(shape) == 4 else 0
        if name not in _MAPS or not isinstance(channels, int) or where.first + where.channels > channels:
            got = f"channels {where.first} to {where.first + where.channels} of {where.output!r}"
            want = f"{', '.join(sorted(_MAPS))}, of channels that an auxiliary or history tensor has"
            _refuse(info, f"map {name!r}", got, want)


def _check_unique(info: ModelInfo, what: str, tensors: Iterable[TensorInfo]) -> None:
    for name, count in Counter(tensor.name for tensor in tensors).items():
        if count > 1:
            _refuse(info, what, f"{name!r} twice", "each name once")


def _named(tensor: TensorInfo) -> set[str]:
    return {extent for extent in tensor.shape if isinstance(extent, str)}


def _text(tensor: TensorInfo) -> str:
    return f"{tensor.shape} {tensor.type}"


def _refuse(info: ModelInfo, what: str, got: str, want: str) -> NoReturn:
    path = info.folder / "model.json"
    raise ModelError(f"{path}: {what}: {got}; want {want}. Export the model again.")
