"""Parity gate: ONNX Runtime must reproduce the images of torch over several frames."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from operator import truediv
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.backends.onnx.runtime import ort
from supersampler.conventions.jitter import only_ratio, scaled
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_export.graph import ExportError, example_inputs, graph_inputs, traced_sizes
from supersampler_model import ops
from supersampler_model.methods.base import LearnedMethod, Method, NetworkSubgraph

Sizes = Sequence[tuple[ops.Size, ops.Size]]
"""Pairs of (render, display)."""
SIZES: Sizes = tuple(
    (ops.Size(*render), ops.Size(*display))
    for render, display in (
        ((26, 18), (52, 37)),  # as traced
        ((80, 45), (160, 90)),
        ((61, 47), (92, 71)),  # odd, at a ratio of 1.5
        ((33, 17), (33, 17)),  # native
        ((21, 13), (63, 39)),
        ((21, 13), (84, 52)),
        ((1, 1), (1, 1)),
        ((1, 9), (3, 28)),
        ((240, 135), (480, 270)),
    )
)
"""Sizes of the gate for methods with a range of ratios; only the first pair is traced."""
RENDERS = [ops.Size(*size) for size in ((80, 45), (61, 47), (33, 17), (1, 1), (1, 9), (2, 2), (120, 68))]
"""Render sizes of the gate for methods with one ratio, in addition to the traced one."""

FRAMES = 4
SHADED = (True, False, True, False, False)
"""Whether each frame of the gate is shaded, for methods that extrapolate."""
AOV_CHANNELS = 3
TOLERANCE = 1e-4
QUANTILE = 0.999
"""Fraction of the values of toned images that differ by at most TOLERANCE.

At the other values a rounding error decides a comparison (closest of two equal depths, floor of a position on
a sample), which is frequent in noise.
"""

TOLERANCE_HALF_NETWORK = 1e-3
"""Tolerance with only the network in half precision, whose relative precision is 5e-4."""
TOLERANCE_HALF = 3e-3
"""Tolerance with all stages in half precision, which round a toned colour several times by up to 2.5e-4."""


@dataclass(frozen=True)
class Parity:
    """Difference of the toned images of torch and ONNX Runtime at one pair of sizes."""

    render: ops.Size
    display: ops.Size
    median: float
    difference: float  # at QUANTILE
    largest: float


def check_parity(method: Method, graph: bytes, tolerance: float = TOLERANCE) -> list[Parity]:
    """Compare torch and ONNX Runtime at all sizes of the gate.

    Raises:
        ExportError: they differ by more than the tolerance.
    """
    options = ort.SessionOptions()
    options.log_severity_level = 3
    session = ort.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    results = [compare(method, session, render, display) for render, display in sizes_of(method)]
    for result in results:
        _check(result, tolerance, f"ONNX Runtime's {method.name}")
    return results


def recorded(results: Sequence[Parity]) -> dict[str, Any]:
    """Return the results of `check_parity` as plain data, for model.json."""
    sizes = [asdict(result) for result in results]
    return {"tolerance": TOLERANCE, "share": QUANTILE, "frames": FRAMES, "sizes": sizes}


def tolerance_of_half(method: Method) -> float:
    """Return the tolerance of a method in half precision."""
    in_half = isinstance(method, LearnedMethod) and method.runs_in_fp16
    return TOLERANCE_HALF if in_half else TOLERANCE_HALF_NETWORK


def check_half(method: Method, half: Method) -> None:
    """Compare a method in half precision with the method itself, in torch.

    Torch rounds like GPUs; ONNX Runtime's CPU provider computes half floats mostly in float32.

    Raises:
        ExportError: they differ by more than the tolerance.
    """
    for render, display in sizes_of(method):
        result = _parity(method, lambda *tensors: half.step(*tensors)[:2], render, display)
        _check(result, tolerance_of_half(method), f"{method.name} in half floats")


def _check(result: Parity, tolerance: float, what: str) -> None:
    if not result.difference <= tolerance:
        sizes = f"{tuple(result.render)} -> {tuple(result.display)}"
        raise ExportError(f"{what} at {sizes} is off by {result.difference:.1e}; want {tolerance:.0e}")


def sizes_of(method: Method) -> Sizes:
    """Return the sizes of the gate for a method; only the first pair is traced."""
    ratio = only_ratio(method.ratios)
    if ratio is None:
        limit = method.ratios[1] + 0.2  # sizes are rounded
        return tuple(pair for pair in SIZES if max(map(truediv, *reversed(pair))) < limit)
    pairs = [(render, scaled(render, ratio)) for render in RENDERS]
    fitting = [(render, ops.Size(*display)) for render, display in pairs if display is not None]
    return [traced_sizes(method), *fitting]


def check_subgraph(subgraph: NetworkSubgraph, graph: bytes) -> None:
    """Compare the network alone in torch and ONNX Runtime, at sizes not traced.

    Raises:
        ExportError: they differ by more than the tolerance, relative to the largest value.
    """
    session = ort.InferenceSession(graph, providers=["CPUExecutionProvider"])
    for half in (ops.Size(16, 8), ops.Size(33, 17), ops.Size(1, 1)):
        inputs = example_inputs(subgraph, half)
        with torch.no_grad():
            ours = subgraph.module(*inputs)
        feeds = {name: value.numpy() for name, value in zip(subgraph.inputs, inputs, strict=True)}
        for name, one, other in zip(subgraph.outputs, ours, session.run(None, feeds), strict=True):
            error = np.abs(one.numpy() - other).max() / max(np.abs(other).max(), 1.0)
            if not error <= TOLERANCE:
                raise ExportError(f"{name} at {tuple(half)}: ONNX Runtime is off by {error:.1e}")


def compare(method: Method, session: ort.InferenceSession, render: ops.Size, display: ops.Size) -> Parity:
    """Step noisy frames in torch and ONNX Runtime, each with its own history."""

    def step(*tensors: Tensor) -> tuple[Tensor, list[Tensor]]:
        feeds = {name: tensor.numpy() for name, tensor in zip(graph_inputs(method), tensors, strict=True)}
        image, *others = (torch.from_numpy(array) for array in session.run(None, feeds))
        return image, others[: len(method.history)]

    return _parity(method, step, render, display)


def _parity(
    method: Method, step: Callable[..., tuple[Tensor, list[Tensor]]], render: ops.Size, display: ops.Size
) -> Parity:
    """Compare the images of noisy frames by `method` and `step`, toned without pre-exposure.

    `step` takes the inputs and the history of the method, and returns an image and the next history.
    """
    shaded = SHADED if method.extrapolates() else (False,) * FRAMES
    ours = theirs = method.first_history(display, render, AOV_CHANNELS)
    differences = []
    for index, frame in enumerate(noise(render, display, len(shaded))):
        if shaded[index]:
            ours, theirs = (method.after_shaded(frame, h if index else None) for h in (ours, theirs))
            continue
        arguments, unit = [frame[name] for name in method.inputs()], frame["pre_exposure"]
        with torch.no_grad():
            image, ours, _ = method.step(*arguments, *ours)
            other, theirs = step(*arguments, *theirs)
        differences.append((ops.tone(image / unit) - ops.tone(other / unit)).abs().numpy().ravel())
    difference = np.concatenate(differences)
    median, high = np.quantile(difference, [0.5, QUANTILE])
    return Parity(render, display, float(median), float(high), float(difference.max()))


def noise(render: ops.Size, display: ops.Size, frames: int) -> Iterator[dict[str, Tensor]]:
    """Yield frames of smooth colour plus noise, sloping depth with steps, and motion of a few pixels.

    G-buffers are other waves, except that depth is the same surface at both sizes. Each frame has another
    pre-exposure, and the second one adds no samples to the mean.
    """
    random = np.random.default_rng(render.width * 1000 + render.height)
    y, x = np.mgrid[: render.height, : render.width].astype(np.float32)
    for index in range(frames):
        a, b, c = random.uniform(0.05, 0.4, 3)
        waves = np.stack([np.sin(a * x + b * y), np.cos(b * x - c * y), np.sin(c * x + a * y)])
        color = np.exp(waves + 0.2 * random.standard_normal(waves.shape))
        depth = 0.02 + 0.01 * (waves[:1] > 0.3) + 1e-4 * x + 1e-5 * random.random(x.shape)
        motion = 2.3 * waves[:2] + 0.31
        yield {
            "color": _tensor(2.0**index * color),
            "depth": _tensor(depth),
            "motion": _tensor(motion),
            "jitter": torch.tensor(random.uniform(-0.5, 0.5, (1, 2)).astype(np.float32)),
            "exposure": torch.zeros(1),
            "pre_exposure": torch.tensor([2.0**index]),
            "adds_samples": torch.tensor([float(index != 1)]),
            "reactive": _tensor((waves[:1] - 0.5).clip(0.0, 1.0)),
            "display_size": torch.tensor(display),
            "aovs": _tensor(0.5 + 0.5 * waves),
            "weight": _tensor(random.random((1, display.height, display.width))),
            **_gbuffers(render, display, phase=a, steps=(a, b)),
        }


def _gbuffers(
    render: ops.Size, display: ops.Size, *, phase: float, steps: tuple[float, float]
) -> dict[str, Tensor]:
    """Return base colour and parameters in [0, 1], unit normals, and the frame's depth."""
    made = {}
    for number, (name, place) in enumerate(GBUFFERS.items()):
        size = display if place.of_display else render
        y, x = np.mgrid[: size.height, : size.width].astype(np.float32)
        x, y = (x + 0.5) * render.width / size.width - 0.5, (y + 0.5) * render.height / size.height - 0.5
        waves = np.stack([np.sin((0.3 + 0.1 * c) * x + 0.2 * y + c + number + phase) for c in range(3)])
        if place.key == "depth":
            a, b = steps
            made[name] = _tensor(0.02 + 0.01 * (np.sin(a * x + b * y) > 0.3)[None] + 1e-4 * x)
        elif place.key == "normal":
            made[name] = _tensor(waves / np.linalg.norm(waves, axis=0).clip(1e-6))
        else:
            made[name] = _tensor(0.5 + 0.5 * waves[: place.channels])
    return made


def _tensor(array: NDArray[np.floating]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(array, np.float32))[None]
