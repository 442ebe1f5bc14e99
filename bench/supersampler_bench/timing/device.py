"""Step time on a device, with frame and image in its memory: of the ONNX backend, and of torch on CUDA."""

import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from supersampler import Frame, Model, Upscaler
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Size
from supersampler.model import Precision
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
from supersampler_bench.specs import compatible, with_default_gbuffers
from supersampler_bench.timing.latency import (
    COPIED,
    WARM_UP,
    fastest,
    frames_of,
    measure_limits,
    quantiles,
    take_turns,
)
from supersampler_model.data.shots import render_size
from supersampler_model.methods import load_method
from supersampler_model.ops.images import Size as Extent


@dataclass(frozen=True)
class OnDevice:
    """Times of one method at one size, milliseconds.

    Attributes:
        method: its name.
        render: (width, height) of the frames.
        display: (width, height) of the images.
        precision: of the network.
        provider: of ONNX Runtime; or torch and its device.
        capture: see `Model.load`; in torch, whether `torch.compile` compiled the step.
        median, p95, p99: wall time of a step, including the wait for the device.
        moved: bytes that a step must move: the frame, the history before and after, the image.
    """

    method: str
    render: Size
    display: Size
    precision: str
    provider: str
    capture: bool
    median: float
    p95: float
    p99: float
    moved: int


class _DeviceRunner:
    """One model, with its frames on the device."""

    def __init__(self, model: Model, display: Size, frames: Sequence[Frame]) -> None:
        self._model, self._render, self._display = model, frames[0].size, display
        self._upscaler = Upscaler(model, display_size=display, validate="off")
        images = [tensor.name for tensor in model.info.inputs if len(tensor.shape) == 4]
        placed = []
        for frame in frames:
            given = frame_inputs(with_default_gbuffers(frame, model.info.gbuffers, display), display, images)
            on_device = {
                name: ort.OrtValue.ortvalue_from_numpy(array, model.device, 0)
                for name, array in given.items()
            }
            placed.append((frame, on_device))
        self._frames = itertools.cycle(placed)
        shape = [1, 3, *display[::-1]]
        self._image = ort.OrtValue.ortvalue_from_shape_and_type(shape, np.float32, model.device, 0)
        history = model.plan(frames[0].size, display).history_bytes
        self._moved = sum(array.nbytes for array in given.values()) + history + 4 * int(np.prod(shape))
        self._wall: list[float] = []
        for _ in range(WARM_UP):
            self.step()
        self._wall.clear()

    def step(self) -> None:
        """Time one step."""
        frame, tensors = next(self._frames)
        began = time.perf_counter()
        self._upscaler.step_tensors(tensors, jitter=frame.jitter, exposure=frame.exposure, out=self._image)
        self._wall.append(1e3 * (time.perf_counter() - began))

    def timed(self) -> OnDevice:
        """Summarise."""
        model = self._model
        sizes = self._render, self._display
        setting = (model.info.method, *sizes, model.precision, model.providers[0], model.capture)
        return OnDevice(*setting, *quantiles(self._wall), self._moved)


def measure_device(
    methods: Sequence[str],
    displays: Sequence[Size],
    precisions: Sequence[Precision],
    *,
    provider: str,
    ratios: Sequence[float] = (2.0,),
    steps: int = 100,
    captures: Sequence[bool] = (False,),
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[OnDevice]:
    """Time all settings; those of one size take turns, step by step.

    Args:
        methods: names of shipped models, or model folders.
        displays: (width, height) of the images.
        precisions: those that a method lacks are left out.
        provider: see `Model.load`.
        ratios: display over render size; those that a method lacks are left out.
        steps: that count, of each.
        captures: each `capture` to time; see `Model.load`.
        on_left_out: called with the reason why a method is left out.
    """
    results = []
    for display, ratio in itertools.product(displays, ratios):
        frames = frames_of(render_size(display, ratio))
        kept = compatible(methods, frames[0].size, display, on_left_out)
        runners = []
        for method, precision, capture in itertools.product(kept, precisions, captures):
            try:
                model = Model.load(
                    method, providers=provider, executor="onnx", precision=precision, capture=capture
                )
            except ArgumentError:  # the method has no such precision
                continue
            runners.append(_DeviceRunner(model, display, frames))
        take_turns(runners, steps)
        results += [runner.timed() for runner in runners]
    return results


def measure_copy(device: str) -> float:
    """Return the bytes a second that a copy in the device's memory moves; 0 where it cannot be measured."""
    if device == "cpu":
        return measure_limits().moved
    import torch

    if device != "cuda" or not torch.cuda.is_available():
        return 0.0
    source = torch.ones(COPIED // 4, device=device)
    target = torch.empty_like(source)

    def copy() -> None:
        target.copy_(source)
        torch.cuda.synchronize()

    copy()
    return 2 * COPIED / fastest(20, copy)


@dataclass(frozen=True)
class DeviceRecord(BenchRecord):
    """Times on a device, and the bytes a second of a copy in its memory (0: not known)."""

    timed: list[OnDevice]
    copied: float
    BENCH = "device"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = [
            [
                f"{size_text(r.render)} to {size_text(r.display)}",
                r.method,
                r.precision,
                r.provider,
                "yes" if r.capture else "no",
                *(f"{time:.2f}" for time in (r.median, r.p95, r.p99)),
                f"{1e-6 * r.moved:.0f}",
                f"{r.median / (1e3 * r.moved / self.copied):.0f}x" if self.copied else "–",
            ]
            for r in self.timed
        ]
        limit = f", at the {1e-9 * self.copied:.0f} GB/s that a copy there reaches" if self.copied else ""
        caption = (
            "A step, frame and image in the device's memory; settings of a size take turns, but those of "
            f"torch. {self.machine_name}. MB: frame, history before and after, and image. Of a copy: "
            f"how many times as long as moving these{limit}."
        )
        headings = ["size", "method", "precision", "provider", "capture", "ms:", "p95:", "p99:", "MB:"]
        return table([*headings, "of a copy:"], rows, caption)


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
