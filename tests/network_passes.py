"""Inputs and outputs of the int8 network in steps of the CPU backend."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import Frame, Model, Upscaler
from supersampler.methods.classifier.cpu import ClassifierCpu
from supersampler.methods.classifier.int8_network import Encoder
from supersampler.methods.classifier.spec import DEFAULT_INPUTS

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]
SIGNED = slice(4 * DEFAULT_INPUTS.index("depth_difference"), 4 * DEFAULT_INPUTS.index("depth_difference") + 4)
"""Planes of `packed` in [-1, 1]; all other inputs are in [0, 1]."""


class Pass(NamedTuple):
    """The network in one step: inputs and outputs as `network.onnx` has them."""

    packed: Floats
    half_inputs: Floats
    logits: Floats
    blend_parameters: Floats

    @property
    def feeds(self) -> dict[str, Floats]:
        return {"packed": self.packed, "half_inputs": self.half_inputs}


def passes_of(
    model: Model,
    frames: list[Frame],
    display: tuple[int, int],
    change: Callable[[Bytes], None] = lambda _: None,
) -> list[Pass]:
    """Step frames on a CPU backend of one thread; return what its network read and wrote.

    `change` may write to the inputs, (half height, half width, 72), before the network runs.
    """
    executor = model._executor
    assert isinstance(executor, ClassifierCpu)
    assert executor.pool.threads == 1
    passes: list[Pass] = []

    def run(self: Encoder, tiles: Any) -> Any:
        change(self.inputs.records.view(np.uint8)[:, : self.inputs.half_width])
        return encode(self, tiles)

    def compose(self: ClassifierCpu, step: Any, view: Any, space: Any, inferred: Any) -> None:
        parameters, width = self.variant.blend_parameters, space.half[0]
        pitch = (width + 15) // 16 * 16
        scratch, rows = space.scratch[0].finish, []

        def finish(*arguments: Any) -> None:
            y0, y1, p0, p1 = arguments[-4:]
            for y in range(y0, y1):
                kernel(*arguments[:-4], y, y + 1, p0, p1)
                blend = scratch.blend.reshape(-1)[: 4 * parameters * pitch].reshape(4, parameters, pitch)
                layers = inferred[1]
                logits = scratch.hidden[:width, layers.logits : layers.logits + 6].T.astype(np.float32)
                rows.append((blend[..., :width].copy(), (logits - 128.0) * layers.logits_scale))

        kernel = self._finish
        patch.setattr(self, "_finish", finish)
        composed(self, step, view, space, inferred)
        patch.setattr(self, "_finish", kernel)
        codes = space.network.inputs.records.view(np.uint8)[:, :width].transpose(2, 0, 1)
        planes = codes * np.float32(1.0 / 255.0)
        planes[SIGNED] = 2.0 * planes[SIGNED] - 1.0
        blend = np.stack([row for row, _ in rows], axis=2)  # (4, parameters, half height, half width)
        blend = blend.transpose(1, 0, 2, 3).reshape(1, 4 * parameters, *blend.shape[2:])
        logits = np.stack([row for _, row in rows], axis=1)[None].astype(np.float32)
        passes.append(Pass(planes[None, :64], planes[None, 64:], logits, blend))

    encode, composed = Encoder.run, ClassifierCpu._compose
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Encoder, "run", run)
        patch.setattr(ClassifierCpu, "_compose", compose)
        upscaler = Upscaler(model, display_size=display, validate="off", skip=False)
        for frame in frames:
            upscaler.step(frame)
    return passes
