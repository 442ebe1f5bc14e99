"""Step times of other runtimes on the same GPU: torch on CUDA, and GPU providers of ONNX Runtime."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from supersampler import Frame, SupersamplerError
from supersampler.backends.onnx.runtime import NAMES, ort
from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Size
from supersampler_bench.timing.latency import WARM_UP, Setting, measure_settings, plaza_frames, quantiles
from supersampler_model.data.rendered import render_size


@dataclass(frozen=True)
class RuntimeStep:
    """Wall times of a method in another runtime: torch on tensors on the GPU, ONNX Runtime on arrays."""

    method: str
    runtime: str  # "torch", "torch, compiled" or "onnx, PROVIDER"
    version: str  # of torch or of ONNX Runtime
    render: Size
    display: Size
    steps: int  # that were timed
    median: float
    p95: float
    first: float  # seconds until the first image, with compilation


def measure_other_runtimes(
    methods: Sequence[str],
    display: Size,
    ratio: float,
    *,
    steps: int,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> Iterator[RuntimeStep]:
    """Time methods in the runtimes that this machine has for its GPU, one after another."""
    frames = plaza_frames(render_size(display, ratio))
    for method in methods:
        yield from _torch_steps(method, display, frames, steps, on_left_out)
    yield from _onnx_steps(methods, display, ratio, steps, on_left_out)


def _torch_steps(
    name: str, display: Size, frames: Sequence[Frame], steps: int, on_left_out: Callable[[str], None]
) -> Iterator[RuntimeStep]:
    try:
        import torch
    except ImportError as error:
        on_left_out(f"torch is left out: {error}")
        return
    if not torch.cuda.is_available():
        on_left_out("torch is left out: it has no CUDA device")
        return
    for compiled in (False, True):
        runtime = "torch, compiled" if compiled else "torch"
        try:
            with torch.no_grad():
                timed, first = _on_cuda(name, display, frames, steps, compiled=compiled)
        except Exception as error:  # the compiler raises many kinds
            on_left_out(f"{name} in {runtime} is left out: {str(error)[:200]}")
            continue
        median, p95, _ = quantiles(timed)
        where = str(torch.__version__), frames[0].size, display, steps
        yield RuntimeStep(name, runtime, *where, median, p95, first)


def _on_cuda(
    name: str, display: Size, frames: Sequence[Frame], steps: int, *, compiled: bool
) -> tuple[list[float], float]:
    import torch

    from supersampler_model.methods import load_method
    from supersampler_model.ops.images import Size as Extent

    began = time.perf_counter()
    method = load_method(name).to("cuda")
    step: Callable[..., Any] = torch.compile(method.step) if compiled else method.step
    placed = [
        [  # the step reads `display_size` on the CPU
            torch.from_numpy(array).to("cpu" if key == "display_size" else "cuda")
            for key, array in frame_inputs(frame, display, method.inputs()).items()
        ]
        for frame in frames
    ]
    history = [one.to("cuda") for one in method.first_history(Extent(*display), Extent(*frames[0].size))]

    def timed(inputs: Sequence[Any]) -> float:
        nonlocal history
        torch.cuda.synchronize()
        started = time.perf_counter()
        _, history, _ = step(*inputs, *history)
        torch.cuda.synchronize()
        return 1e3 * (time.perf_counter() - started)

    turns = itertools.cycle(placed)
    timed(next(turns))
    first = time.perf_counter() - began
    return [timed(next(turns)) for _ in range(steps + WARM_UP)][WARM_UP:], first


def _onnx_steps(
    methods: Sequence[str], display: Size, ratio: float, steps: int, on_left_out: Callable[[str], None]
) -> Iterator[RuntimeStep]:
    if find_spec("onnxruntime") is None:  # a measuring kit may lack it
        on_left_out("ONNX Runtime is left out: it is not installed")
        return
    settings = [Setting(method, display, "onnx", 0) for method in methods]
    installed = ort.get_available_providers()
    for name, provider in NAMES.items():
        if name == "cpu" or provider not in installed:
            continue
        try:
            timed = measure_settings(
                settings, providers=name, ratio=ratio, steps=steps, on_left_out=on_left_out
            )
        except SupersamplerError as error:
            on_left_out(f"{provider} is left out: {error}")
            continue
        for one in timed[1:]:  # after the reference on the CPU
            where = ort.__version__, render_size(display, ratio), display, steps
            yield RuntimeStep(
                one.setting.method, f"onnx, {name}", *where, one.median, one.p95, 1e-3 * one.first
            )
