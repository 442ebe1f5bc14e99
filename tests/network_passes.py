"""Inputs and outputs of the int8 network of the CPU library, on real and on hostile inputs."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from supersampler import Frame, Model
from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.frame import Float32, Size
from supersampler.methods.classifier.spec import CLASSES, DEFAULT_INPUTS, Variant
from supersampler.methods.spec import half_size, large_size
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_network import pack
from supersampler_model.ops.images import Size as ModelSize
from torch_inputs import tensors_of

Bytes = NDArray[np.uint8]
SIGNED = slice(4 * DEFAULT_INPUTS.index("depth_difference"), 4 * DEFAULT_INPUTS.index("depth_difference") + 4)
"""Planes of `packed` in [-1, 1]; all other inputs are in [0, 1]."""


class Pass(NamedTuple):
    """One run of the network: inputs and outputs as `network.onnx` has them."""

    packed: Float32
    half_inputs: Float32
    logits: Float32
    blend_parameters: Float32

    @property
    def feeds(self) -> dict[str, Float32]:
        return {"packed": self.packed, "half_inputs": self.half_inputs}


def pass_of(model: Model, codes: Bytes) -> Pass:
    """Run the network on inputs as bytes, (half height, half width, 72)."""
    executor = model._executor
    assert isinstance(executor, CpuExecutor)
    height, width = codes.shape[:2]
    variant = Variant.of(model.info.config)
    outputs = 4 * variant.blend_parameters
    values = np.empty((outputs + CLASSES, height, width), np.float32)
    given = np.ascontiguousarray(codes)
    executor._library.call(
        "ss_run_network", executor._model.handle, given.ctypes.data, width, height, values.ctypes.data
    )
    planes = codes.transpose(2, 0, 1) * np.float32(1.0 / 255.0)
    planes[SIGNED] = 2.0 * planes[SIGNED] - 1.0
    return Pass(planes[None, :64], planes[None, 64:], values[None, outputs:], values[None, :outputs])


def inputs_of(
    method: Classifier, frames: Iterable[Frame], display: Size, patch: pytest.MonkeyPatch
) -> list[Bytes]:
    """Step frames in torch; return the inputs of its network as bytes, (half height, half width, 72)."""
    found: list[Bytes] = []
    infer = cast("Callable[..., tuple[torch.Tensor, torch.Tensor]]", method.net.on_pixels)
    history: Any = None
    width, height = half_size(large_size(display) if method.larger else display)

    def keep(pixels: Sequence[torch.Tensor], half_inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        planes = torch.cat([pack(torch.cat([*pixels], dim=1)), half_inputs], dim=1)[0].numpy().copy()
        planes[SIGNED] = 0.5 + 0.5 * planes[SIGNED]
        codes = np.floor(planes.clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        found.append(codes[:, :height, :width].transpose(1, 2, 0))
        return infer(pixels, half_inputs)

    patch.setattr(method.net, "on_pixels", keep)
    for frame in frames:
        if history is None:
            history = method.first_history(ModelSize(*display), ModelSize(*frame.size))
        with torch.no_grad():
            _, history, _ = method.step(*tensors_of(frame, display, method.inputs()).values(), *history)
    return found
