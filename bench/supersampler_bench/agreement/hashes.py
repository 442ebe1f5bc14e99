"""Hashes of images and histories, which show whether two versions compute the same, bit for bit.

Hashes depend on the processor's instructions, on ONNX Runtime and on numba, so records are compared on the
machine that wrote them. Where hashes differ, sketches show by how much: a sketch is the sum of an image's
values with random signs, so the squared difference of two sketches is on average the squared difference of
the images, and no image has to be kept.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Upscaler
from supersampler.frame import Float32, Size
from supersampler.methods.model_file import model_names
from supersampler.model import ExecutorName, Precision, Skip
from supersampler_bench.record import Record, machine_name
from supersampler_bench.timing.speed import frames_of

FRAMES = 24
"""Of a run."""
SIZES: tuple[tuple[Size, Size], ...] = (
    ((64, 36), (128, 72)),
    ((53, 31), (106, 62)),
    ((61, 37), (101, 59)),
    ((45, 27), (131, 77)),
    ((123, 67), (187, 103)),
)
"""Render and display sizes; methods of one ratio have that multiple of the render size instead."""
MEASURED = (53, 31)
"""Render size of the frames without exposure: the method measures it."""
EXTRAPOLATED = tuple(product(("classifier", "extrapolate"), ("guided-warp", "guided-flow")))
"""Upscalers and the models that extrapolate every second frame for them."""
RUNS: tuple[tuple[ExecutorName, Precision, Skip], ...] = (
    ("onnx", "fp32", "exact"),
    ("onnx", "fp16", "exact"),
    ("cpu", "auto", "exact"),
    ("cpu", "auto", "auto"),
)
THREADS = 2
_SIGNS = 8  # sketches of a run


@dataclass(frozen=True)
class Subject:
    """A shipped model, how it runs, and the model that extrapolates unshaded frames for it, if any."""

    method: str
    extrapolation: str | None
    executor: ExecutorName
    precision: Precision
    skip: Skip

    def __str__(self) -> str:
        name = self.method if self.extrapolation is None else f"{self.method}+{self.extrapolation}"
        return f"{name}, {self.executor} {self.precision}, skip {self.skip}"


@dataclass(frozen=True)
class Hashed:
    """One subject's images at one size.

    Attributes:
        subject: model and how it ran.
        render: (width, height) of the frames.
        display: of the images.
        frames: SHA-256 of each image.
        history: of the tensors that the last frame left, by name.
        sketches: of all images as one vector, values c / (1 + c), divided by the root of their number.
    """

    subject: Subject
    render: Size
    display: Size
    frames: list[str]
    history: dict[str, str]
    sketches: list[float]

    @property
    def name(self) -> str:
        """Subject and sizes, in words."""
        return f"{self.subject}, {_sizes(self.render, self.display)}"


def _sizes(render: Size, display: Size) -> str:
    return f"{render[0]}x{render[1]} to {display[0]}x{display[1]}"


def subjects(methods: Sequence[str] | None = None) -> list[Subject]:
    """Return every way in which the shipped models run on a CPU.

    Args:
        methods: names of models, those with what extrapolates for them included; all where None.

    Raises:
        ModelError: there is no such model.
    """
    names = list(methods or model_names())
    pairs: list[tuple[str, str | None]] = [(name, None) for name in names]
    pairs += [pair for pair in EXTRAPOLATED if pair[0] in names]
    found = []
    for (name, extrapolation), (executor, precision, skip) in product(pairs, RUNS):
        try:
            model = _model(name, executor, precision)
        except ArgumentError:  # the model does not run so
            continue
        precision = cast("Precision", model.precision)
        found.append(Subject(name, extrapolation, executor, precision, skip))
    return found


def measure_hashes(
    measured: Sequence[Subject],
    sizes: Sequence[tuple[Size, Size]],
    *,
    on_run: Callable[[], None] = lambda: None,
) -> list[Hashed]:
    """Step each subject through `FRAMES` frames at each size.

    Args:
        measured: models and how they run.
        sizes: render and display sizes, (width, height).
        on_run: called after each subject and size.
    """
    results = []
    for (render, display), subject in product(sizes, measured):
        ratio = _model(subject.method, subject.executor, subject.precision).info.only_ratio
        if ratio is not None:
            display = (round(render[0] * ratio), round(render[1] * ratio))
        results.append(_hashed(subject, render, display))
        on_run()
    return results


def _hashed(subject: Subject, render: Size, display: Size) -> Hashed:
    upscaler = _upscaler(subject, display)
    frames, sketches = [], np.zeros(_SIGNS)
    for index, frame in enumerate(scene(render, display, subject.skip)):
        unshaded = subject.extrapolation is not None and index % 2 == 1
        image = upscaler.extrapolate(replace(frame, color=None)) if unshaded else upscaler.step(frame)
        frames.append(_sha256(image))
        values = image.ravel().astype(np.float64)
        sketches += _signs_of_frames()[:, index] * (_signs(values.size) @ (values / (1.0 + values)))
    sketches /= np.sqrt(FRAMES * values.size)
    history = upscaler.save_state().history or {}
    tensors = {name: _sha256(history[name]) for name in sorted(history) if name.startswith("history.")}
    return Hashed(subject, render, display, frames, tensors, [float(f"{s:.12g}") for s in sketches])


def _upscaler(subject: Subject, display: Size) -> Upscaler:
    runs: dict[str, Any] = {"display_size": display, "skip": subject.skip, "validate": "off"}
    if subject.extrapolation is None:
        return Upscaler(_model(subject.method, subject.executor, subject.precision), **runs)
    runs |= {"executor": subject.executor, "precision": subject.precision, "threads": THREADS}
    return Upscaler(subject.method, extrapolation=subject.extrapolation, providers="cpu", **runs)


@lru_cache
def _model(method: str, executor: ExecutorName, precision: Precision) -> Model:
    return Model.load(method, providers="cpu", threads=THREADS, executor=executor, precision=precision)


@lru_cache(maxsize=8)
def scene(render: Size, display: Size, skip: Skip = "exact") -> list[Frame]:
    """Return `FRAMES` frames with all G-buffers: the shipped shot, or what `skip` leaves partly as it is.

    That is two frames in turn, of little contrast so that images soon settle, but for a corner that rolls.
    """
    shot = frames_of(render, 0, FRAMES)
    if skip != "exact":
        shot = [_still(shot[index % 2], index) for index in range(FRAMES)]
    exposures = (None if render == MEASURED else frame.exposure for frame in shot)
    shaded = (replace(frame, exposure=exposure) for frame, exposure in zip(shot, exposures, strict=True))
    return [_with_gbuffers(frame, display) for frame in shaded]


def _still(frame: Frame, index: int) -> Frame:
    color = np.array(frame.color)
    corner = slice(frame.size[1] // 3), slice(frame.size[0] // 3)
    rolled = np.roll(color[corner], index, 1)
    color = np.float32(0.4) + np.float32(0.01) * color
    color[corner] = rolled
    return replace(frame, color=color, motion=np.zeros_like(frame.motion))


def _with_gbuffers(frame: Frame, display: Size) -> Frame:
    """Return a frame with G-buffers of both sizes made of its colour, which differs from pixel to pixel."""
    color = np.asarray(frame.color)
    shown = (color / (1.0 + color)).astype(np.float32)
    normal = shown - np.float32(0.3)
    normal /= np.sqrt((normal**2).sum(-1, keepdims=True)) + np.float32(1e-6)
    normal[frame.depth == 0.0] = 0.0
    buffers = {
        "base_color": shown,
        "normal": normal,
        "roughness": shown[..., 0],
        "metallic": shown[..., 1],
        "specular": shown[..., 2],
    }
    buffers = {name: np.ascontiguousarray(buffer) for name, buffer in buffers.items()}
    nearest = {name: _resized(buffer, display) for name, buffer in buffers.items()}
    depth = _resized(np.asarray(frame.depth, np.float32), display)
    return replace(frame, gbuffer=buffers, gbuffer_display={**nearest, "depth": depth})


def _resized(image: Float32, size: Size) -> Float32:
    rows, columns = (np.arange(n) * old // n for n, old in zip(size[::-1], image.shape[:2], strict=True))
    return np.ascontiguousarray(image[rows[:, None], columns])


def _sha256(array: NDArray[Any]) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


@lru_cache(maxsize=4)
def _signs(count: int) -> NDArray[np.float64]:
    """(sketches, count) of 1 and -1, the same with every version of numpy."""
    bits = np.random.PCG64(count).random_raw(_SIGNS * (-(-count // 64))).view(np.uint8)
    return np.unpackbits(bits).reshape(_SIGNS, -1)[:, :count].astype(np.float64) * 2.0 - 1.0


def _signs_of_frames() -> NDArray[np.float64]:
    return _signs(FRAMES)


def hashes_record(results: Sequence[Hashed]) -> dict[str, Any]:
    """Return all values, ready for JSON, with hashes of the frames that went in."""
    kinds = sorted({(r.render, r.display, r.subject.skip) for r in results})
    inputs = {f"{_sizes(*kind[:2])}, skip {kind[2]}": _of_scene(*kind) for kind in kinds}
    return {
        "bench": "hashes",
        "frames": FRAMES,
        "threads": THREADS,
        "inputs": inputs,
        "hashed": [asdict(result) for result in results],
    }


def _of_scene(render: Size, display: Size, skip: Skip) -> str:
    whole = hashlib.sha256()
    for frame in scene(render, display, skip):
        arrays = [frame.color, frame.depth, frame.motion]
        arrays += [*(frame.gbuffer or {}).values(), *(frame.gbuffer_display or {}).values()]
        for array in arrays:
            whole.update(np.ascontiguousarray(array).data)
        whole.update(repr((frame.jitter, frame.exposure, frame.reset)).encode())
    return whole.hexdigest()


def hashed_of(record: Record) -> list[Hashed]:
    """Return what `hashes_record` was made of."""
    return [
        Hashed(
            **{
                **row,
                "subject": Subject(**row["subject"]),
                "render": tuple(row["render"]),
                "display": tuple(row["display"]),
            }
        )
        for row in record["hashed"]
    ]


def differences(before: Record, after: Record, *, partly: bool = False) -> Iterator[str]:
    """Say what of `before` is another in `after`, a line for each subject and size.

    Args:
        before: an earlier record.
        after: a later one.
        partly: whether subjects may be missing in `after`.
    """
    new = {result.name: result for result in hashed_of(after)}
    for kind, digest in before["inputs"].items():
        if after["inputs"].get(kind, digest) != digest:
            yield f"{kind}: the frames that go in are others, so images cannot be the same"
    for old in hashed_of(before):
        if old.name in new:
            yield from _difference(old, new[old.name])
        elif not partly:
            yield f"{old.name}: missing"


def _difference(old: Hashed, new: Hashed) -> Iterator[str]:
    frames = [i for i, (a, b) in enumerate(zip(old.frames, new.frames, strict=True)) if a != b]
    tensors = [name for name, digest in old.history.items() if new.history.get(name) != digest]
    if frames:
        off = np.sqrt(np.mean(np.subtract(old.sketches, new.sketches) ** 2))
        yield (
            f"{old.name}: {len(frames)} of {len(old.frames)} images differ, the first is frame {frames[0]}; "
            f"root mean square of c / (1 + c) over all images: about {off:.1g}"
        )
    elif tensors:
        yield f"{old.name}: images are the same, but of the history {', '.join(tensors)}"


def other_setting(before: Record, after: Record) -> str:
    """Say in which ways records are of unlike machines or versions; "" where they are not."""
    pairs = [("machine", machine_name(before), machine_name(after))]
    versions, others = before["versions"], after["versions"]
    pairs += [(name, versions.get(name), others.get(name)) for name in versions if name != "supersampler"]
    unlike = [f"{name} {old}, here {new}" for name, old, new in pairs if old != new]
    return f"recorded with {'; '.join(unlike)}: hashes may differ for that alone" if unlike else ""


def markdown_table(record: Record) -> str:
    """Return a table with one hash of all images and histories for each subject."""
    digests: dict[Subject, Any] = {}
    for result in hashed_of(record):
        digest = digests.setdefault(result.subject, hashlib.sha256())
        digest.update("".join([*result.frames, *result.history.values()]).encode())
    rows = [f"| {subject} | {digest.hexdigest()[:16]} |" for subject, digest in digests.items()]
    caption = f"{record['frames']} frames at {len(SIZES)} sizes. {machine_name(record)}."
    return "\n".join(["| method | images and history (SHA-256) |", "| --- | --- |", *rows, "", caption])
