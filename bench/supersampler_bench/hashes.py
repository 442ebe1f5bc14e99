"""Hashes of images and histories, to check that two versions compute the same ones, bit for bit.

Every shipped model steps through 16 frames at five sizes, or 48 where most of the frame is static, in
every way that it runs on a CPU. Hashes depend on the processor's instructions, on ONNX Runtime and on the
compiler, so compare records of one machine.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Upscaler
from supersampler.arguments import ExecutorName, Precision
from supersampler.frame import Float32, Size
from supersampler.methods.model_file import model_names
from supersampler_bench.record import BenchRecord, sizes_text
from supersampler_bench.specs import incompatibility
from supersampler_bench.timing.latency import plaza_frames

FRAMES, STILL_FRAMES = 16, 48
"""Frames of a run, and of a run in which most of the frame is static."""
SIZES: tuple[tuple[Size, Size], ...] = (
    ((64, 36), (128, 72)),
    ((53, 31), (106, 62)),
    ((61, 37), (101, 59)),
    ((45, 27), (131, 77)),
    ((123, 67), (187, 103)),
)
"""Render and display sizes. Methods of one ratio have that multiple of the render size as display size.
A method skips sizes whose ratio it does not support."""
MEASURED_EXPOSURE = (53, 31)
"""Render size of the frames without exposure, which the method then measures."""
EXTRAPOLATED = tuple(product(("classifier", "extrapolate"), ("guided-warp", "guided-flow")))
"""Upscalers, each with the model that extrapolates every second frame for it."""
RUNS: tuple[tuple[ExecutorName, Precision, bool], ...] = (
    ("onnx", "fp32", False),
    ("onnx", "fp16", False),
    ("cpu", "auto", False),
    ("cpu", "auto", True),
)
"""Executor, precision, and whether most of the frame is static."""
STILL = ", at rest"
PHASES = 16
"""Period of the static scene, frames."""
THREADS = 2


@dataclass(frozen=True)
class ModelRun:
    """A shipped model, how it runs, and the model that extrapolates unshaded frames for it, if any."""

    method: str
    extrapolation: str | None
    executor: ExecutorName
    precision: Precision
    still: bool

    def __str__(self) -> str:
        name = self.method if self.extrapolation is None else f"{self.method}+{self.extrapolation}"
        return f"{name}, {self.executor} {self.precision}{STILL * self.still}"


@lru_cache
def _model(method: str, executor: ExecutorName, precision: Precision) -> Model:
    return Model.load(method, providers="cpu", threads=THREADS, executor=executor, precision=precision)


@dataclass(frozen=True)
class Hashed:
    """SHA-256 of one run's images, and of its history tensors after the last frame, by name."""

    subject: ModelRun
    render: Size
    display: Size
    frames: list[str]
    history: dict[str, str]

    @property
    def name(self) -> str:
        """Model, run and sizes as text, which identify the run in another record."""
        return f"{self.subject}, {sizes_text(self.render, self.display)}"

    @property
    def input_name(self) -> str:
        """Name of the input frames."""
        return sizes_text(self.render, self.display) + STILL * self.subject.still


@dataclass(frozen=True)
class HashesRecord(BenchRecord):
    """Hashes of all runs, and of the frames that they read, by `Hashed.input_name`."""

    inputs: dict[str, str]
    hashed: list[Hashed]
    BENCH = "hashes"
    TABLES = ()

    @classmethod
    def of(cls, hashed: list[Hashed]) -> "HashesRecord":
        """Return the record of some runs."""
        frames = {one.input_name: (one.render, one.display, one.subject.still) for one in hashed}
        return cls({name: _hash_of_frames(scene(*kind)) for name, kind in frames.items()}, hashed)


def subjects(methods: Sequence[str] | None = None) -> list[ModelRun]:
    """Return the ways in which the models, by default all shipped ones, run on a CPU."""
    names = list(methods or model_names())
    pairs: list[tuple[str, str | None]] = [(name, None) for name in names]
    pairs += [pair for pair in EXTRAPOLATED if pair[0] in names]
    found = []
    for (name, extrapolation), (executor, precision, still) in product(pairs, RUNS):
        try:
            model = _model(name, executor, precision)
        except ArgumentError:  # the model has no such executor or precision
            continue
        precision = cast("Precision", model.precision)
        found.append(ModelRun(name, extrapolation, executor, precision, still))
    return found


def measure_hashes(
    measured: Sequence[ModelRun],
    sizes: Sequence[tuple[Size, Size]],
    *,
    on_run: Callable[[], None] = lambda: None,
) -> list[Hashed]:
    """Step each run through the frames of `scene` at each (render, display) size whose ratio it supports."""
    results = []
    for (render, display), subject in product(sizes, measured):
        ratio = _model(subject.method, subject.executor, subject.precision).info.only_ratio
        if ratio is not None:
            display = (round(render[0] * ratio), round(render[1] * ratio))
        if not incompatibility(subject.method, render, display):
            results.append(_hashed(subject, render, display))
        on_run()
    return results


def _hashed(subject: ModelRun, render: Size, display: Size) -> Hashed:
    upscaler = upscaler_of(subject, display)
    frames = []
    for index, frame in enumerate(scene(render, display, subject.still)):
        unshaded = subject.extrapolation is not None and index % 2 == 1
        image = upscaler.extrapolate(replace(frame, color=None)) if unshaded else upscaler.step(frame)
        frames.append(_sha256(image))
    history = upscaler.save_state().history or {}
    tensors = {name: _sha256(history[name]) for name in sorted(history) if name.startswith("history.")}
    return Hashed(subject, render, display, frames, tensors)


def upscaler_of(subject: ModelRun, display: Size) -> Upscaler:
    """Return a new Upscaler for a run."""
    runs: dict[str, Any] = {"display_size": display, "validate": "off"}
    if subject.extrapolation is None:
        return Upscaler(_model(subject.method, subject.executor, subject.precision), **runs)
    runs |= {"executor": subject.executor, "precision": subject.precision, "threads": THREADS}
    return Upscaler(subject.method, extrapolation=subject.extrapolation, providers="cpu", **runs)


@lru_cache(maxsize=8)
def scene(render: Size, display: Size, still: bool = False) -> list[Frame]:
    """Return frames of the shipped shot with all G-buffers.

    With `still`, `PHASES` frames repeat, and only one corner changes from frame to frame.
    """
    shot = plaza_frames(render, 0, FRAMES)
    if still:
        shot = [_still(shot[index % PHASES], index) for index in range(STILL_FRAMES)]
    if render == MEASURED_EXPOSURE:
        shot = [replace(frame, exposure=None) for frame in shot]
    return [_with_gbuffers(frame, display) for frame in shot]


def _still(frame: Frame, index: int) -> Frame:
    color = np.array(frame.color)
    corner = slice(frame.size[1] // 3), slice(frame.size[0] // 3)
    rolled = np.roll(color[corner], index, 1)
    color = np.float32(0.4) + np.float32(0.01) * color
    color[corner] = rolled
    return replace(frame, color=color, motion=np.zeros_like(frame.motion))


def _with_gbuffers(frame: Frame, display: Size) -> Frame:
    """Return a frame with G-buffers of both sizes, made from its colour."""
    color = np.asarray(frame.color)
    shown = (color / (1.0 + color)).astype(np.float32)
    normal = shown - np.float32(0.3)
    normal /= np.sqrt((normal**2).sum(-1, keepdims=True)) + np.float32(1e-6)
    normal[frame.depth == 0.0] = 0.0
    gbuffer = {"base_color": shown, "normal": normal}
    for channel, name in enumerate(("roughness", "metallic", "specular")):
        gbuffer[name] = np.ascontiguousarray(shown[..., channel])
    full = {**gbuffer, "depth": np.asarray(frame.depth, np.float32)}
    return replace(frame, gbuffer=gbuffer, gbuffer_display={n: _resized(b, display) for n, b in full.items()})


def _resized(image: Float32, size: Size) -> Float32:
    rows, columns = (np.arange(n) * old // n for n, old in zip(size[::-1], image.shape[:2], strict=True))
    return np.asarray(image[rows[:, None], columns])


def _sha256(array: NDArray[Any]) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


def _hash_of_frames(frames: Sequence[Frame]) -> str:
    whole = hashlib.sha256()
    for frame in frames:
        arrays = [frame.color, frame.depth, frame.motion]
        arrays += [*(frame.gbuffer or {}).values(), *(frame.gbuffer_display or {}).values()]
        for array in arrays:
            whole.update(np.ascontiguousarray(array).data)
        whole.update(repr((frame.jitter, frame.exposure, frame.reset)).encode())
    return whole.hexdigest()


def differences(before: HashesRecord, after: HashesRecord, *, partly: bool = False) -> Iterator[str]:
    """Yield a line for each run that differs or is in one record only; `partly`: `after` may lack runs."""
    new = {result.name: result for result in after.hashed}
    changed = [name for name, digest in before.inputs.items() if after.inputs.get(name, digest) != digest]
    yield from (f"{name}: the input frames differ, so images are not compared" for name in changed)
    for old in before.hashed:
        if old.input_name in changed:
            continue
        if old.name in new:
            yield from _difference(old, new[old.name])
        elif not partly:
            yield f"{old.name}: missing"
    known = {old.name for old in before.hashed}
    yield from (f"{name}: not in the record" for name in new if name not in known)


def _difference(old: Hashed, new: Hashed) -> Iterator[str]:
    frames = [i for i, (a, b) in enumerate(zip(old.frames, new.frames, strict=True)) if a != b]
    tensors = [name for name, digest in old.history.items() if new.history.get(name) != digest]
    if frames:
        yield f"{old.name}: {len(frames)} of {len(old.frames)} images differ, the first is frame {frames[0]}"
    elif tensors:
        yield f"{old.name}: images are the same, but these history tensors differ: {', '.join(tensors)}"


def unlike_versions(before: HashesRecord, after: HashesRecord) -> str:
    """Return the machine and the packages that differ, which alone may change hashes; "" if none does."""
    then, now = (
        {**record.provenance.versions, "supersampler": None, "machine": record.machine_name}
        for record in (before, after)
    )
    return "; ".join(
        f"{name} {then[name]}, here {now.get(name)}" for name in then if then[name] != now.get(name)
    )
