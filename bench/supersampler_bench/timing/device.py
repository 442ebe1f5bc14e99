"""Step time of the ONNX backend on its device, with frame and image in device memory."""

import itertools
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from supersampler import Frame, Model, Upscaler
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import frame_inputs
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.model import Precision
from supersampler_bench.compatibility import incompatibility, with_default_gbuffers
from supersampler_bench.record import Record, machine_name
from supersampler_bench.timing.speed import COPIED, WARM_UP, frames_of, measure_limits


@dataclass(frozen=True)
class OnDevice:
    """Of one method at one size; milliseconds.

    Attributes:
        method: which.
        display: (width, height) of the images.
        precision: of what is learned.
        provider: of ONNX Runtime.
        capture: see `Model.load`.
        median, p95, p99: wall time of a step, the device waited for.
        moved: bytes that a step must move: the frame, the history before and after, the image.
    """

    method: str
    display: Size
    precision: str
    provider: str
    capture: bool
    median: float
    p95: float
    p99: float
    moved: int


class _Runner:
    """One method, with its frames on the device."""

    def __init__(
        self,
        method: str,
        display: Size,
        precision: Precision,
        provider: str,
        frames: Sequence[Frame],
        *,
        capture: bool,
    ) -> None:
        self._model = Model.load(
            method, providers=provider, executor="onnx", precision=precision, capture=capture
        )
        device = self._model.device
        frames = [with_default_gbuffers(frame, self._model.info.gbuffers, display) for frame in frames]
        self._display = display
        self._upscaler = Upscaler(self._model, display_size=display, validate="off")
        images = [tensor.name for tensor in self._model.info.inputs if len(tensor.shape) == 4]
        placed = []
        for frame in frames:
            given = frame_inputs(frame, display, images)
            placed.append((frame, {name: _placed(array, device) for name, array in given.items()}))
        self._frames = itertools.cycle(placed)
        size = (1, 3, *display[::-1])
        self._image = ort.OrtValue.ortvalue_from_shape_and_type(list(size), np.float32, device, 0)
        history = self._model.plan(frames[0].size, display).history_bytes
        self._moved = sum(array.nbytes for array in given.values()) + history + 4 * int(np.prod(size))
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
        p95, p99 = (float(np.quantile(self._wall, share)) for share in (0.95, 0.99))
        model = self._model
        return OnDevice(
            method=model.info.method,
            display=self._display,
            precision=model.precision,
            provider=model.providers[0],
            capture=model.capture,
            median=statistics.median(self._wall),
            p95=p95,
            p99=p99,
            moved=self._moved,
        )


def _placed(array: np.ndarray[Any, Any], device: str) -> ort.OrtValue:
    return ort.OrtValue.ortvalue_from_numpy(array, device, 0)


def measure_device(
    methods: Sequence[str],
    displays: Sequence[Size],
    precisions: Sequence[Precision],
    *,
    provider: str,
    ratio: float = 2.0,
    steps: int = 100,
    captures: Sequence[bool] = (False,),
    on_step: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[OnDevice]:
    """Time all; those of one size take turns, step by step.

    Args:
        methods: names of models.
        displays: (width, height) of the images.
        precisions: of those that a method has.
        provider: see `Model.load`.
        ratio: display over render size.
        steps: that count, of each.
        captures: each `capture` to time; see `Model.load`.
        on_step: called after each.
        on_left_out: called with the name of a method that does not run so, and why.
    """
    results = []
    for display in displays:
        frames = frames_of((round(display[0] / ratio), round(display[1] / ratio)))
        reasons = {method: incompatibility(method, frames[0].size, display) for method in methods}
        for reason in filter(None, reasons.values()):
            on_left_out(reason)
        kept = [method for method in methods if not reasons[method]]
        runners = []
        for method, precision, capture in itertools.product(kept, precisions, captures):
            try:
                runners.append(_Runner(method, display, precision, provider, frames, capture=capture))
            except ArgumentError:  # the method has no such precision
                continue
        for _ in range(steps):
            for runner in runners:
                runner.step()
                on_step()
        results += [runner.timed() for runner in runners]
    return results


def measure_copy(device: str) -> float:
    """Bytes a second that a copy within the device's memory moves; 0 where nothing here can measure it."""
    if device == "cpu":
        return measure_limits().moved
    import torch

    if device != "cuda" or not torch.cuda.is_available():
        return 0.0
    source = torch.ones(COPIED // 4, device=device)
    target = torch.empty_like(source)
    times = []
    for _ in range(20):
        torch.cuda.synchronize()
        began = time.perf_counter()
        target.copy_(source)
        torch.cuda.synchronize()
        times.append(time.perf_counter() - began)
    return 2 * COPIED / min(times)


def device_record(results: Sequence[OnDevice], copied: float, ratio: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    timed = [asdict(r) for r in results]
    return {"bench": "device", "ratio": ratio, "timed": timed, "copied": copied}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    results, copied = [OnDevice(**row) for row in record["timed"]], record["copied"]
    rows = [
        "| display | method | precision | provider | capture | ms | p95 | p99 | MB | of a copy |",
        "| --- | --- | --- | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    for r in results:
        share = f"{r.median / (1e3 * r.moved / copied):.0f}x" if copied else "–"
        capture = "yes" if r.capture else "no"
        rows.append(
            f"| {r.display[0]}x{r.display[1]} | {r.method} | {r.precision} | {r.provider} | {capture} "
            f"| {r.median:.2f} | {r.p95:.2f} | {r.p99:.2f} | {1e-6 * r.moved:.0f} | {share} |"
        )
    limit = f", at the {1e-9 * copied:.0f} GB/s that a copy there reaches" if copied else ""
    caption = (
        f"A step at ratio {record['ratio']:g}, frame and image in the device's memory; settings of a size "
        f"take turns. {machine_name(record)}. MB: frame, history before and after, and image. Of a copy: "
        f"how many times as long as moving these{limit}."
    )
    return "\n".join([*rows, "", caption])
