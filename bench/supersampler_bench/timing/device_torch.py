"""Step time of the torch modules on CUDA: a second opinion on what fused shaders save."""

import itertools
import time
from collections.abc import Callable, Sequence
from typing import Any

import torch

from supersampler import Frame
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import DeviceError
from supersampler.frame import Size
from supersampler_bench.compatibility import compatible
from supersampler_bench.timing.device import OnDevice
from supersampler_bench.timing.latency import WARM_UP, frames_of, quantiles
from supersampler_model.data.shots import render_size
from supersampler_model.methods import load_method
from supersampler_model.ops.images import Size as Extent


def measure_torch(
    methods: Sequence[str],
    displays: Sequence[Size],
    ratios: Sequence[float],
    *,
    steps: int,
    compiled: Sequence[bool] = (False,),
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[OnDevice]:
    """Time shipped methods in float32, one after another.

    Args:
        methods: their names.
        displays: (width, height) of the images.
        ratios: display over render size; those that a method lacks are left out.
        steps: that count, of each.
        compiled: whether `torch.compile` compiles the step, each to time.
        on_left_out: called with the reason why a method is left out.

    Raises:
        DeviceError: torch has no CUDA device.
    """
    if not torch.cuda.is_available():
        raise DeviceError("torch has no CUDA device")
    results = []
    for display, ratio in itertools.product(displays, ratios):
        frames = frames_of(render_size(display, ratio))
        kept = compatible(methods, frames[0].size, display, on_left_out)
        results += [_timed(*one, display, frames, steps) for one in itertools.product(kept, compiled)]
    return results


@torch.no_grad()
def _timed(name: str, compiled: bool, display: Size, frames: Sequence[Frame], steps: int) -> OnDevice:
    method = load_method(name).to("cuda")
    step: Callable[..., Any] = torch.compile(method.step) if compiled else method.step
    placed = [
        [  # the program reads `display_size`
            torch.from_numpy(array).to("cpu" if name == "display_size" else "cuda")
            for name, array in frame_inputs(frame, display, method.inputs()).items()
        ]
        for frame in frames
    ]
    history = [one.to("cuda") for one in method.first_history(Extent(*display), Extent(*frames[0].size))]
    wall = []
    for inputs in itertools.islice(itertools.cycle(placed), steps + WARM_UP):
        torch.cuda.synchronize()
        began = time.perf_counter()
        image, history, _ = step(*inputs, *history)
        torch.cuda.synchronize()
        wall.append(1e3 * (time.perf_counter() - began))
    moved = sum(one.nbytes for one in (*placed[0], *history, *history, image))
    provider = f"torch {torch.__version__}, {torch.cuda.get_device_name()}"
    return OnDevice(
        name, frames[0].size, display, "fp32", provider, compiled, *quantiles(wall[WARM_UP:]), moved
    )
