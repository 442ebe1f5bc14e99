"""Shipped graphs freeze what stands still as torch does, with a mean in float32."""

from pathlib import Path

import numpy as np
import pytest
import torch

from supersampler import halton_jitter
from supersampler.backends.onnx.runtime import ort
from supersampler.conventions import jitter_phase_count
from supersampler.methods.model_file import find_model
from supersampler_export.graph import graph_inputs
from supersampler_model import ops
from supersampler_model.data.scenes.analytic import still_scene
from supersampler_model.methods import load_method
from supersampler_model.methods.taau import Taau
from torch_inputs import tensors_of

METHODS = ["taau", "classifier"]
RENDER, DISPLAY = ops.Size(64, 36), ops.Size(128, 72)
FROZEN = 2 * jitter_phase_count(2.0) + 1
"""Frames after which a still scene is frozen."""
GRAPHS = [
    (name, file)
    for name in METHODS
    for file in ("step.onnx", "step.fp16.onnx")
    if (find_model(name) / file).exists()
]


def inputs_of(index: int) -> dict[str, torch.Tensor]:
    """Frame `index` of a still scene."""
    frame = still_scene().frame(index, RENDER, halton_jitter(index, 2.0))
    return tensors_of(frame, DISPLAY, [*Taau.inputs(), "reactive"])


def session_of(path: Path) -> ort.InferenceSession:
    return ort.InferenceSession(path, providers=["CPUExecutionProvider"])


@pytest.mark.long  # two periods of the jitter
@pytest.mark.parametrize("name", METHODS)
def test_the_shipped_graph_freezes_and_restarts_as_torch_does(name: str) -> None:
    method, session = load_method(name), session_of(find_model(name) / "step.onnx")
    ours = theirs = method.first_history(DISPLAY, RENDER)
    outputs = [output.name for output in session.get_outputs()]
    converged = []
    for index in range(FROZEN + 2):
        frame = inputs_of(index)
        if index == FROZEN:
            frame["color"] = 4.0 * frame["color"]
        arguments = [frame[name] for name in method.inputs()]
        with torch.no_grad():
            image, ours, _ = method.step(*arguments, *ours)
        feeds = {
            name: value.numpy()
            for name, value in zip(graph_inputs(method), [*arguments, *theirs], strict=True)
        }
        made = dict(zip(outputs, map(torch.from_numpy, session.run(None, feeds)), strict=True))
        theirs = [made[f"next.{name}"] for name in method.history]
        difference = (ops.tone(image) - ops.tone(made["image"])).abs()
        assert torch.quantile(difference, 0.99) < 1e-4, index
        converged.append(float(made["converged"].mean()))
    assert max(converged[: FROZEN - 2]) == 0.0
    assert converged[FROZEN - 1] > 0.7
    assert converged[FROZEN] == 0.0


@pytest.mark.parametrize(("name", "file"), GRAPHS)
def test_a_mean_of_many_samples_still_takes_a_small_difference(name: str, file: str) -> None:
    """W / N' is below 1 / 1024: in half floats the mean would not change, nor its weight."""
    method, session = load_method(name), session_of(find_model(name) / file)
    frame = inputs_of(1) | {"color": torch.full((1, 3, RENDER.height, RENDER.width), 0.52)}
    before = dict(zip(method.history, method.first_history(DISPLAY, RENDER), strict=True))
    before["static_mean"][:, :3], before["static_mean"][:, 3:] = 0.5, 2000.0
    feeds = {name: frame[name].numpy() for name in method.inputs()}
    feeds |= {f"history.{name}": value.numpy() for name, value in before.items()}
    (still,) = session.run(["next.static_mean"], feeds)
    sampled = still[:, 3:] > 2000.2
    assert sampled.mean() > 0.2
    assert (still[:, :3][np.repeat(sampled, 3, axis=1)] > 0.5).all()
    assert still[:, 3:].max() < 2002.0
