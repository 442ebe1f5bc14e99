"""Check whether two versions compute the same images and histories, bit for bit, by their hashes.

    python bench/studies/hashes.py --check bench/results/studies/hashes.json     # also: make hashes
    python bench/studies/hashes.py --json hashes.json

Every shipped model steps through 24 frames at five sizes, or 48 where most of the frame is static, in
every way that it runs on a CPU. Hashes depend on the processor's instructions, on ONNX Runtime and on the
compiler, so compare records of one machine.

A record also has sketches, which estimate how far images are apart although no image is kept. A sketch is the
sum of an image's values with random signs: the squared difference of two sketches is on average the squared
difference of the images.
"""

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from numpy.typing import NDArray

from supersampler import ArgumentError, Frame, Model, Upscaler
from supersampler.cli.terminal import Terminal
from supersampler.frame import Float32, Size
from supersampler.methods.model_file import model_names
from supersampler.model import ExecutorName, Precision
from supersampler_bench.cli.options import JSON, counted, say, split_list, warn
from supersampler_bench.record import JsonRecord, Provenance, machine_name, read_record, write_json
from supersampler_bench.specs import incompatibility
from supersampler_bench.timing.latency import plaza_frames

FRAMES, STILL_FRAMES = 24, 48
"""Frames of a run; frames of a run in which most of the frame is static."""
SIZES: tuple[tuple[Size, Size], ...] = (
    ((64, 36), (128, 72)),
    ((53, 31), (106, 62)),
    ((61, 37), (101, 59)),
    ((45, 27), (131, 77)),
    ((123, 67), (187, 103)),
)
"""Render and display sizes; methods of one ratio have that multiple of the render size instead.
Sizes of ratios that a method lacks are left out."""
MEASURED_EXPOSURE = (53, 31)
"""Render size at which frames have no exposure, so that the method measures it."""
EXTRAPOLATED = tuple(product(("classifier", "extrapolate"), ("guided-warp", "guided-flow")))
"""Pairs of an upscaler and the model that extrapolates every second frame for it."""
RUNS: tuple[tuple[ExecutorName, Precision, bool], ...] = (
    ("onnx", "fp32", False),
    ("onnx", "fp16", False),
    ("cpu", "auto", False),
    ("cpu", "auto", True),
)
STILL = ", at rest"
"""Suffix of the name of a run in which most of the frame is static."""
PHASES = 16
"""Frames of the static scene, which repeat."""
THREADS = 2
_SKETCHES = 8  # sketches of a run


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


@dataclass(frozen=True)
class Hashed:
    """Hashes of one run's images at one size.

    Attributes:
        subject: model and how it ran.
        render, display: (width, height).
        frames: SHA-256 of each image.
        history: SHA-256 of each history tensor after the last frame, by name.
        sketches: sketches of all images as one vector of values c / (1 + c), divided by the square root of
            the number of values.
    """

    subject: ModelRun
    render: Size
    display: Size
    frames: list[str]
    history: dict[str, str]
    sketches: list[float]

    @property
    def name(self) -> str:
        """Model, run and sizes as text, to find the same run in another record."""
        return f"{self.subject}, {_sizes(self.render, self.display)}"


def _sizes(render: Size, display: Size) -> str:
    return f"{render[0]}x{render[1]} to {display[0]}x{display[1]}"


def subjects(methods: Sequence[str] | None = None) -> list[ModelRun]:
    """Return every way in which models (all shipped ones by default) run on a CPU."""
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
    """Step each subject through the frames of `scene` at each (render, display) size whose ratio it has."""
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
    upscaler = _upscaler(subject, display)
    frames, sketches = [], np.zeros(_SKETCHES)
    run = scene(render, display, still=subject.still)
    for index, frame in enumerate(run):
        unshaded = subject.extrapolation is not None and index % 2 == 1
        image = upscaler.extrapolate(replace(frame, color=None)) if unshaded else upscaler.step(frame)
        frames.append(_sha256(image))
        values = image.ravel().astype(np.float64)
        sketches += _signs(len(run))[:, index] * (_signs(values.size) @ (values / (1.0 + values)))
    sketches /= np.sqrt(len(run) * values.size)
    history = upscaler.save_state().history or {}
    tensors = {name: _sha256(history[name]) for name in sorted(history) if name.startswith("history.")}
    return Hashed(subject, render, display, frames, tensors, [float(f"{s:.12g}") for s in sketches])


def _upscaler(subject: ModelRun, display: Size) -> Upscaler:
    runs: dict[str, Any] = {"display_size": display, "validate": "off"}
    if subject.extrapolation is None:
        return Upscaler(_model(subject.method, subject.executor, subject.precision), **runs)
    runs |= {"executor": subject.executor, "precision": subject.precision, "threads": THREADS}
    return Upscaler(subject.method, extrapolation=subject.extrapolation, providers="cpu", **runs)


@lru_cache
def _model(method: str, executor: ExecutorName, precision: Precision) -> Model:
    return Model.load(method, providers="cpu", threads=THREADS, executor=executor, precision=precision)


@lru_cache(maxsize=8)
def scene(render: Size, display: Size, *, still: bool = False) -> list[Frame]:
    """Return frames of the shipped shot with all G-buffers.

    Static: `PHASES` frames repeat, and only one corner changes from frame to frame.
    """
    shot = plaza_frames(render, 0, FRAMES)
    if still:
        shot = [_still(shot[index % PHASES], index) for index in range(STILL_FRAMES)]
    exposures = (None if render == MEASURED_EXPOSURE else frame.exposure for frame in shot)
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
    """Return (_SKETCHES, count) random signs, 1 or -1, the same with every version of numpy."""
    bits = np.random.PCG64(count).random_raw(_SKETCHES * (-(-count // 64))).view(np.uint8)
    return np.unpackbits(bits).reshape(_SKETCHES, -1)[:, :count].astype(np.float64) * 2.0 - 1.0


def hashes_record(results: Sequence[Hashed]) -> dict[str, Any]:
    """Return all values, ready for JSON, with hashes of the input frames."""
    kinds = sorted({(r.render, r.display, r.subject.still) for r in results})
    inputs = {_sizes(*sizes) + STILL * still: _hash_of_scene(*sizes, still=still) for *sizes, still in kinds}
    return {
        "bench": "hashes",
        "frames": FRAMES,
        "threads": THREADS,
        "inputs": inputs,
        "hashed": [asdict(result) for result in results],
    }


def _hash_of_scene(render: Size, display: Size, *, still: bool) -> str:
    whole = hashlib.sha256()
    for frame in scene(render, display, still=still):
        arrays = [frame.color, frame.depth, frame.motion]
        arrays += [*(frame.gbuffer or {}).values(), *(frame.gbuffer_display or {}).values()]
        for array in arrays:
            whole.update(np.ascontiguousarray(array).data)
        whole.update(repr((frame.jitter, frame.exposure, frame.reset)).encode())
    return whole.hexdigest()


def hashed_of(record: JsonRecord) -> list[Hashed]:
    """Return the results in a record by `hashes_record`."""
    return [
        Hashed(
            **{
                **row,
                "subject": ModelRun(**row["subject"]),
                "render": tuple(row["render"]),
                "display": tuple(row["display"]),
            }
        )
        for row in record["hashed"]
    ]


def differences(before: JsonRecord, after: JsonRecord, *, partly: bool = False) -> Iterator[str]:
    """Yield a line for each run whose images or history differ; `partly`: runs may be missing in `after`."""
    new = {result.name: result for result in hashed_of(after)}
    inputs = before["inputs"]
    changed = [kind for kind, digest in inputs.items() if after["inputs"].get(kind, digest) != digest]
    yield from (f"{kind}: the input frames differ, so images are not compared" for kind in changed)
    for old in hashed_of(before):
        if _sizes(old.render, old.display) + STILL * old.subject.still in changed:
            continue
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
        yield f"{old.name}: images are the same, but these history tensors differ: {', '.join(tensors)}"


def other_setting(before: JsonRecord, after: JsonRecord) -> str:
    """Return how machines and versions of two records differ, as a sentence; "" where they do not."""
    pairs = [("machine", machine_name(before), machine_name(after))]
    versions, others = before["versions"], after["versions"]
    pairs += [(name, versions.get(name), others.get(name)) for name in versions if name != "supersampler"]
    unlike = [f"{name} {old}, here {new}" for name, old, new in pairs if old != new]
    return f"recorded with {'; '.join(unlike)}: hashes may differ for that reason alone" if unlike else ""


def main(
    methods: Annotated[
        str | None, typer.Option(help="Names of shipped models, with commas between.", show_default="all")
    ] = None,
    json: JSON = None,
    check: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Compare with this earlier record; fail where anything differs."),
    ] = None,
) -> None:
    """Hash every image and the last history of the shipped models, in every way that they run on a CPU."""
    before = None if check is None else read_record(check)
    if before is not None and before["bench"] != "hashes":
        raise ArgumentError(
            "--check", got=f"{check}, of `{before['bench']}`", want="a record of this program"
        )
    chosen = None if methods is None else split_list(methods)
    hashed = subjects(chosen)
    with counted("runs", len(SIZES) * len(hashed)) as advance:
        results = measure_hashes(hashed, SIZES, on_run=advance)
    record = hashes_record(results)
    here = {**record, **asdict(Provenance.now())}
    if json is not None:
        write_json(here, json)
    if before is None:
        return
    found = list(differences(before, here, partly=chosen is not None))
    for text in found:
        Terminal().print(text, soft_wrap=True)
    say(f"{len(results)} runs: {len(found)} differ from {check}")
    if found:
        if unlike := other_setting(before, here):
            warn(unlike)
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
