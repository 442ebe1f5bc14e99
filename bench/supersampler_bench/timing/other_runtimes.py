"""Step times of a method elsewhere on the same GPU: torch on CUDA, and ONNX Runtime's other providers."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.backends.onnx.runtime import NAMES
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import SupersamplerError
from supersampler.frame import Size
from supersampler_bench.timing.latency import WARM_UP, plaza_frames, quantiles
from supersampler_model.data.shots import render_size


@dataclass(frozen=True)
class RuntimeStep:
    """Times of a method in another runtime, milliseconds of wall time.

    Attributes:
        method: its name.
        runtime: "torch", "torch, compiled" or "onnx, PROVIDER".
        version: version of torch or of ONNX Runtime.
        render: (width, height) of the frames.
        display: (width, height) of the images.
        steps: steps that were timed.
        median, p95: of a step; in torch on frames on the GPU, in ONNX Runtime from arrays to arrays.
        first: seconds until the first image, with what has to be compiled for it.
    """

    method: str
    runtime: str
    version: str
    render: Size
    display: Size
    steps: int
    median: float
    p95: float
    first: float


def measure_other_runtimes(
    methods: Sequence[str],
    display: Size,
    ratio: float,
    *,
    steps: int,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> Iterator[RuntimeStep]:
    """Time methods in the runtimes that this machine has for its GPU, one after another.

    Args:
        methods: names of shipped models.
        display: (width, height) of the images.
        ratio: display over render size.
        steps: measured steps of each.
        on_left_out: called with the reason why something is left out.
    """
    frames = plaza_frames(render_size(display, ratio))
    for method in methods:
        for measure in (_torch_steps, _onnx_steps):
            yield from measure(method, display, frames, steps, on_left_out)


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
        except Exception as error:  # the compiler raises whatever it stumbles over
            on_left_out(f"{name} in {runtime} is left out: {str(error)[:200]}")
            continue
        yield _summary(name, runtime, torch.__version__, display, frames, timed, first)


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
        [  # `display_size` is read by the program itself
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
    name: str, display: Size, frames: Sequence[Frame], steps: int, on_left_out: Callable[[str], None]
) -> Iterator[RuntimeStep]:
    try:
        import onnxruntime
    except ImportError as error:
        on_left_out(f"ONNX Runtime is left out: {error}")
        return
    for key, provider in NAMES.items():
        if key == "cpu" or provider not in onnxruntime.get_available_providers():
            continue
        try:
            began = time.perf_counter()
            model = Model.load(name, executor="onnx", providers=key)
            upscaler = Upscaler(model, display_size=display, validate="off")
            image = np.empty((*display[::-1], 3), np.float32)
            upscaler.step(frames[0], out=image)
            first, times = time.perf_counter() - began, []
            for frame in itertools.islice(itertools.cycle(frames), steps + WARM_UP):
                started = time.perf_counter()
                upscaler.step(frame, out=image)
                times.append(1e3 * (time.perf_counter() - started))
        except SupersamplerError as error:
            on_left_out(f"{name} by {provider} is left out: {error}")
            continue
        runtime = f"onnx, {provider}"
        yield _summary(name, runtime, onnxruntime.__version__, display, frames, times[WARM_UP:], first)


def _summary(
    name: str,
    runtime: str,
    version: str,
    display: Size,
    frames: Sequence[Frame],
    times: list[float],
    first: float,
) -> RuntimeStep:
    median, p95, _ = quantiles(times)
    return RuntimeStep(name, runtime, version, frames[0].size, display, len(times), median, p95, first)
