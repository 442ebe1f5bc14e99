"""Shipped graphs and torch return the same from a step, over frames that use every branch of a method.

Shipped graphs do not change with the code, so these tests fail if a change of the code changes images.
"""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from hostile_frames import BAD, EXPOSURES, RENDER, display_of, frames
from supersampler.backends.onnx.runtime import ort
from supersampler.methods.model_file import find_model
from supersampler.methods.registry import methods
from supersampler_export.graph import graph_inputs
from supersampler_model.methods import load_method
from supersampler_model.methods.aovs import BlendAovs
from supersampler_model.methods.base import Method

SHIPPED = [name for name, spec in methods().items() if spec.ships]
SHADED = (True, False, False, True, False, True, False)
"""Frames that are shaded, for methods that extrapolate the others."""


def dotted(image: Tensor) -> Tensor:
    """The image with few NaN values: interpolation between these and others differs by provider."""
    image = image.clone()
    for place, bad in enumerate(BAD):
        image[..., 2 + place, 3 * place :: 17] = bad
    return image


def assert_alike(name: str, ours: Tensor, theirs: Tensor) -> None:
    """Equal but for rounding that decides no comparison: relative to a channel's mean, logarithmic.

    Missing samples of the last shaded frame stay missing in the history of methods that extrapolate.
    """
    assert ours.shape == theirs.shape, name
    assert torch.equal(ours.isnan(), theirs.isnan()), name
    if "color of frame" in name:
        ours, theirs = (t.nan_to_num(nan=0.0, posinf=torch.inf) for t in (ours, theirs))
    assert ours.isfinite().all(), name
    usual = theirs.abs().mean(dim=tuple(range(2, theirs.ndim)), keepdim=True).clamp(min=1e-6)
    one, other = (torch.sign(t) * (t.abs() / usual).log1p() for t in (ours, theirs))
    off = (one - other).abs().numpy().ravel()
    assert np.quantile(off, 0.98) <= 2e-3, name  # a mask shows more of what is made of bad rows
    assert off.mean() <= 1e-3, name


@pytest.mark.long  # every method in torch
@pytest.mark.parametrize("name", SHIPPED)
def test_image_history_and_stats_are_those_of_the_shipped_graph(name: str) -> None:
    assert_steps_alike(load_method(name), find_model(name) / "step.onnx")


def test_channels_that_frames_carry_are_blended_as_the_shipped_graph_blends_them() -> None:
    assert_steps_alike(BlendAovs(), find_model("bilinear") / "aovs.onnx")


def assert_steps_alike(method: Method, graph: Path) -> None:
    """Step both on the same frames, from the history that torch has left."""
    session = ort.InferenceSession(graph, providers=["CPUExecutionProvider"])
    display = display_of(method)
    history = method.first_history(display, RENDER, 3)
    shapes = [t.shape for t in history]
    shaded = SHADED if method.extrapolates() else (False,) * len(EXPOSURES)
    for index, frame in enumerate(frames(display)):
        if shaded[index]:
            history = method.after_shaded(frame, history if index else None)
            assert [t.shape for t in history] == shapes
            continue
        if index == 4 and "color" in method.history:  # which no step leaves
            at = list(method.history).index("color")
            history = [*history[:at], dotted(history[at]), *history[at + 1 :]]
        arguments = [frame[name] for name in method.inputs()]
        with torch.no_grad():
            image, after, aux_outputs = method.step(*arguments, *history)
        feeds = {
            key: value.numpy()
            for key, value in zip(graph_inputs(method), [*arguments, *history], strict=True)
        }
        theirs = [torch.from_numpy(array) for array in session.run(None, feeds)]
        outputs = ["image", *method.history, *method.spec.aux_outputs]
        for output, a, b in zip(outputs, [image, *after, *aux_outputs], theirs, strict=True):
            assert_alike(f"{output} of frame {index}", a, b)
        assert [t.shape for t in after] == shapes
        history = after
