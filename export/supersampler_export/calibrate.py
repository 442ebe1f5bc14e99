"""Calibration for `quantize`: output ranges of the network's layers on real frames."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from supersampler import Frame
from supersampler.backends.onnx.session import frame_inputs
from supersampler.io.shot import Shot
from supersampler_model.methods.classifier.buffers import Gathered
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import unpack
from supersampler_model.ops.size import Size

SCALES, FRAMES = (1.5, 2.5), 10  # ratios that the shipped shot is stepped at, frames of each
SHARE = 0.9999
"""Quantile at which a range ends; outliers would make the quantization of all other values coarser."""
MARGIN = 1.5
"""Factor for scenes with larger values than the calibration shot."""


def calibrated(method: Classifier) -> dict[str, float]:
    """Step the shipped shot at several ratios; return the range of each layer's output, by name.

    Rounded to two digits, so that rounding errors of the arithmetic do not change the int8 network.
    """
    ranges: dict[str, float] = {}
    layers = {name: layer for name, layer in method.net.named_modules() if _is_quantized(name)}
    hooks = [layer.register_forward_hook(_record_range(name, ranges)) for name, layer in layers.items()]

    def infer(gathered: Gathered) -> tuple[Tensor, Tensor]:
        logits, blend = method.net(*method.network_inputs(gathered))
        return logits, unpack(blend)

    vars(method)["infer"] = infer  # layer by layer, on packed pixels: as the int8 network computes
    try:
        for scale in SCALES:
            _step_shot(method, scale)
    finally:
        del vars(method)["infer"]
        for hook in hooks:
            hook.remove()
    return {name: float(f"{MARGIN * value:.1e}") for name, value in ranges.items()}


def _is_quantized(name: str) -> bool:
    """Whether the output of a layer is quantized: parts of blocks, decoder, compositor, classes."""
    path = name.split(".")
    return name in ("hidden", "classes") or (path[0], len(path)) in (("encoder", 4), ("decoder", 2))


def _record_range(name: str, ranges: dict[str, float]) -> Callable[[nn.Module, object, Tensor], None]:
    def note(_: nn.Module, __: object, given: Tensor) -> None:
        values = given.abs().flatten()
        rank = max(round((1.0 - SHARE) * len(values)), 1)
        ranges[name] = max(ranges.get(name, 0.0), float(torch.topk(values, rank).values[-1]))

    return note


def _step_shot(method: Classifier, scale: float) -> None:
    shot = Shot.open("plaza")
    render = Size(*shot.info.render_size)
    display = Size(round(render.width * scale), round(render.height * scale))
    history = method.first_history(display, render)
    for item in itertools.islice(shot, FRAMES):
        frame = painted(item.frame, display) if "gbuffer_base_color" in method.inputs() else item.frame
        inputs = {
            name: torch.from_numpy(np.ascontiguousarray(value))
            for name, value in frame_inputs(frame, display, method.inputs()).items()
        }
        with torch.no_grad():
            history = method.step(*(inputs[name] for name in method.inputs()), *history).history


def painted(frame: Frame, display: tuple[int, int]) -> Frame:
    """Return a frame with G-buffers, as if its toned colours were those of flat surfaces that face one way.

    The shipped shot has none. At display size they are those of the nearest samples.
    """
    color = np.maximum(np.asarray(frame.color, np.float32), 0.0)
    base = color / (1.0 + color.max(axis=2, keepdims=True))
    normal = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), base.shape)
    width, height = frame.size
    rows = np.arange(display[1])[:, None] * height // display[1]
    columns = np.arange(display[0]) * width // display[0]
    found = {"base_color": base, "normal": normal, "depth": np.asarray(frame.depth, np.float32)}
    return replace(
        frame,
        gbuffer={"base_color": base, "normal": normal},
        gbuffer_display={name: image[rows, columns] for name, image in found.items()},
    )
