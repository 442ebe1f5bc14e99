"""Differences of the backends, and of torch in half floats, from torch in float32 over hundreds of frames.

ONNX Runtime's CPU provider computes fp16 graphs mostly in float32; torch rounds like GPUs.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from supersampler import Frame, Model, Upscaler
from supersampler.arguments import ExecutorName, Precision
from supersampler.backends.onnx.session import frame_inputs
from supersampler.cli.arguments import size_text
from supersampler.conventions.jitter import only_ratio, scaled
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.methods.registry import methods
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.shots.rendering import rendered_sequence
from supersampler_bench.specs import gbuffers_of
from supersampler_export.half import to_half
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.methods import load_method
from supersampler_model.ops.images import Size as Extent

SIZES: Sequence[tuple[Size, Size]] = (((160, 90), (320, 180)), ((107, 61), (160, 91)))
"""(render, display). The second pair is odd, at ratio 1.5."""
RENDERS: Sequence[Size] = ((80, 45), (53, 31))
"""Render sizes of methods of one ratio."""
FAMILY = "market"
"""Family of the test shot, which is rendered with more frames."""
RUNS: Sequence[tuple[ExecutorName, Precision]] = (
    ("onnx", "fp32"),
    ("onnx", "fp16"),
    ("cpu", "auto"),
    ("gpu", "auto"),
)
"""Executors and precisions that are compared with torch, as far as the method and the machine have them."""
Step = Callable[[Frame], Float32]


@dataclass(frozen=True)
class Agreement:
    """Differences from torch's images, in [0, 1] after the display transform."""

    method: str
    runs: str  # executor and precision
    render: Size
    display: Size
    frames: int
    first: float  # mean over the first tenth of the frames
    last: float  # mean over the last tenth
    psnr: float  # dB, over the last tenth
    p999: float  # largest 99.9th percentile of a frame


def measure_parity(
    methods: Sequence[str], frames: int, *, on_frame: Callable[[], None] = lambda: None
) -> list[Agreement]:
    """Step torch and the backends, each with its own history, through the same frames at each size."""
    results = []
    for (render, display), names in methods_by_size(methods).items():
        steppers = {(m, runs): step for m in names for runs, step in _steppers(m, render, display)}
        found: dict[tuple[str, str], list[tuple[float, float, float]]] = {
            key: [] for key in steppers if key[1] != "torch"
        }
        renderer, gbuffers = Renderer(display, samples=1), bool(gbuffers_of(names))
        for frame, _ in rendered_sequence(renderer, FAMILY, frames, render, gbuffers=gbuffers):
            images = {
                key: display_transform(step(frame), frame.exposure or 1.0) for key, step in steppers.items()
            }
            for (method, runs), rows in found.items():
                off = np.abs(images[method, runs] - images[method, "torch"])
                rows.append((float(off.mean()), float(np.square(off).mean()), float(np.quantile(off, 0.999))))
            on_frame()
        results += [_agreement(*key, render, display, np.array(rows)) for key, rows in found.items()]
    return results


def methods_by_size(methods: Sequence[str]) -> Mapping[tuple[Size, Size], Sequence[str]]:
    """Return the methods that run at each (render, display)."""
    found: dict[tuple[Size, Size], list[str]] = {}
    for method in methods:
        ratio = only_ratio(read_model_info(find_model(method)).ratios)
        sizes = SIZES if ratio is None else [(render, scaled(render, ratio)) for render in RENDERS]
        for render, display in sizes:
            if display is not None:
                found.setdefault((render, display), []).append(method)
    return found


def _agreement(method: str, runs: str, render: Size, display: Size, found: Any) -> Agreement:
    tenth = max(len(found) // 10, 1)
    mean, squared, p999 = found.T
    psnr = float(-10.0 * np.log10(max(squared[-tenth:].mean(), 1e-12)))
    first, last = float(mean[:tenth].mean()), float(mean[-tenth:].mean())
    return Agreement(method, runs, render, display, len(found), first, last, psnr, float(p999.max()))


def _steppers(method: str, render: Size, display: Size) -> Iterator[tuple[str, Step]]:
    yield "torch", stepper_of_torch(method, render, display)
    if methods()[method].task:
        yield "torch, fp16", stepper_of_torch(method, render, display, half=True)
    for executor, precision in RUNS:
        try:
            model = Model.load(method, providers="cpu", executor=executor, precision=precision)
        except (ArgumentError, DeviceError):  # the method or this machine has no such executor
            continue
        upscaler = Upscaler(model, display_size=display, validate="off")
        yield f"{executor}, {model.precision}", upscaler.step


def stepper_of_torch(name: str, render: Size, display: Size, *, half: bool = False) -> Step:
    """Return the step of a shipped method in torch, in half floats with `half`, with its own history.

    Raises:
        ArgumentError: `half`, and the method has no network.
    """
    method = load_method(name)
    if half:
        lowered = to_half(method)
        if lowered is None:
            raise ArgumentError("precision", got=f"fp16 of {name}", want="a method with a network")
        method = lowered
    history = method.first_history(Extent(*display), Extent(*render))

    @torch.no_grad()
    def step(frame: Frame) -> Float32:
        nonlocal history
        inputs = frame_inputs(frame, display, method.inputs())
        image, history, _ = method.step(*(torch.from_numpy(array) for array in inputs.values()), *history)
        return np.ascontiguousarray(image[0].permute(1, 2, 0).numpy(), np.float32)

    return step


@dataclass(frozen=True)
class ParityRecord(BenchRecord):
    """Differences from torch."""

    results: list[Agreement]
    BENCH = "parity"

    def table(self) -> str:
        """Return the table of methods and sizes."""
        rows = [
            [
                *(r.method, r.runs, size_text(r.display)),
                *(f"{r.first:.1e}", f"{r.last:.1e}", f"{r.psnr:.1f}", f"{r.p999:.1e}"),
            ]
            for r in self.results
        ]
        caption = (
            "Difference from the images of torch, in [0, 1] after the display transform, over "
            f"{self.results[0].frames} consecutive frames: means over the first and the last tenth."
        )
        headings = ["method", "runs", "display", "first:", "last:", "PSNR dB, last:", "at 99.9 %:"]
        return table(headings, rows, caption)
