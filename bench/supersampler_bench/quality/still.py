"""Scenes before a camera that stands: how near methods come to what the samples hold, and in what time."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Model, Upscaler, halton_jitter
from supersampler.backends.cpu.static_weights import StaticWeights
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import decibels, display_transform
from supersampler.model import ExecutorName, Skip
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.analytic import Scene
from supersampler_model.data.scenes.still_life import still_scene, still_scene_with_mover
from supersampler_model.data.sequences import HeldSequence
from supersampler_model.data.shots import render_size
from supersampler_model.data.specs import SequenceSpec

PERIODS = (1, 2, 4)
"""Jitter periods after which images are scored."""
SCENES = ("analytic", "analytic-mover", "court", "gallery-mover")
"""The analytic scene and test shots with a fixed camera; objects move in those that end with MOVER."""
MOVER = "-mover"
HELD_FRAME = 12  # frame of the test shot whose camera is kept
TIMED = 8  # frames of the first period that are timed as full steps, after as many that are not
_REACH = 8  # display pixels around what moved that are not scored
_UNCHANGED = 1.0 / 255.0  # of references, as a screen shows them

Source = tuple[Callable[[int], Frame], Callable[[int], Float32]]
"""Frames and references by index."""


@dataclass(frozen=True)
class StillScores:
    """One method in one scene at one ratio; pixels that never moved.

    Attributes:
        scene: of SCENES.
        ratio: display over render size.
        method: the model's name.
        psnr: dB after PERIODS: mean over the last quarter of the period before.
        best: dB of the weighted mean of the last period's samples (`StaticWeights`).
        flicker: mean over pixels of the standard deviation of display values in the last period, [0, 1].
        share: time of a frame in the last period over that of a full step.
        milliseconds: median time of a full step.
    """

    scene: str
    ratio: float
    method: str
    psnr: list[float]
    best: float
    flicker: float
    share: float
    milliseconds: float


def measure_still(
    scenes: Sequence[str],
    methods: Sequence[str],
    display: Size,
    *,
    ratios: Sequence[float] = (1.0, 1.5, 2.0, 3.0),
    executor: ExecutorName = "cpu",
    skip: Skip = "auto",
    samples: int = 64,
    on_frame: Callable[[], None] = lambda: None,
) -> list[StillScores]:
    """Step methods through scenes for four jitter periods at each ratio.

    Args:
        scenes: of SCENES.
        methods: names of models.
        display: (width, height) of the images.
        ratios: display over render size.
        executor: see `Model.load`.
        skip: see `Upscaler`.
        samples: a pixel of the test shots' references.
        on_frame: called after each frame of a scene.
    """
    results: list[StillScores] = []
    for scene in scenes:
        for ratio in ratios:
            frames, truth = _source(scene, display, ratio, samples)
            runs = {name: _Run(Model.load(name, executor=executor), display, skip) for name in methods}
            results += _scores(scene, ratio, display, frames, truth, runs, on_frame)
    return results


def frame_count(ratio: float) -> int:
    """Frames of a scene."""
    return PERIODS[-1] * jitter_phase_count(ratio)


def offline_mean(frames: Sequence[Frame], display: Size) -> Float32:
    """Return the best weighted mean of the samples of one jitter period: (H, W, 3) linear RGB.

    Args:
        frames: of one period, of one size.
        display: (width, height).
    """
    weights = StaticWeights(display, frames[0].size, [frame.jitter for frame in frames])
    total, mass = np.zeros((*display[::-1], 3)), np.zeros(display[::-1])
    for index, frame in enumerate(frames):
        rows, columns = (np.maximum(axis.sample[index], 0) for axis in (weights.rows, weights.columns))
        used = weights.of_frame(index)
        mass += used
        total += used[..., None] * np.asarray(frame.color)[rows][:, columns]
    return np.maximum(total / np.maximum(mass, 1e-6)[..., None], 0.0).astype(np.float32)


class _Run:
    """One method's way through a scene."""

    def __init__(self, model: Model, display: Size, skip: Skip) -> None:
        self._upscaler = Upscaler(model, display_size=display, skip=skip, validate="off")
        self._image = np.empty((*display[::-1], 3), np.float32)
        self.milliseconds: list[float] = []

    def step(self, frame: Frame) -> Float32:
        """Step; return what a screen shows."""
        began = time.perf_counter()
        self._upscaler.step(frame, out=self._image)
        self.milliseconds.append(1e3 * (time.perf_counter() - began))
        return display_transform(self._image, frame.exposure or 1.0)


def _scores(
    scene: str,
    ratio: float,
    display: Size,
    frames: Callable[[int], Frame],
    truth: Callable[[int], Float32],
    runs: dict[str, _Run],
    on_frame: Callable[[], None],
) -> Iterator[StillScores]:
    period = jitter_phase_count(ratio)
    quarter = max(period // 4, 1)
    ends = [count * period for count in PERIODS]
    scored = {end: range(end - quarter, end) for end in ends}
    images: dict[str, dict[int, Float32]] = {name: {} for name in runs}
    truths, moved, last = {}, np.zeros(display[::-1], bool), []
    for index in range(ends[-1]):
        frame = frames(index)
        moved |= _moving(frame, display)
        late = index >= ends[-1] - period
        if late:
            last.append(frame)
        for name, run in runs.items():
            image = run.step(frame)
            if late or any(index in part for part in scored.values()):
                images[name][index] = image
        if index + 1 in ends:
            truths[index + 1] = display_transform(truth(index), frame.exposure or 1.0)
        on_frame()
    changed = np.ptp(np.stack(list(truths.values())), axis=0).max(-1) > _UNCHANGED
    still = ~(moved | changed)
    best = display_transform(offline_mean(last, display), last[0].exposure or 1.0)
    for name, run in runs.items():
        shown = np.stack([images[name][index][still] for index in range(ends[-1] - period, ends[-1])])
        full = median(run.milliseconds[TIMED // 2 : TIMED // 2 + TIMED])
        psnr = [
            float(np.mean([_psnr(images[name][i], truths[end], still) for i in scored[end]])) for end in ends
        ]
        yield StillScores(
            scene=scene,
            ratio=ratio,
            method=name,
            psnr=psnr,
            best=_psnr(best, truths[ends[-1]], still),
            flicker=float(shown.std(axis=0).mean()),
            share=median(run.milliseconds[-period:]) / full,
            milliseconds=full,
        )


def _psnr(image: Float32, truth: Float32, where: NDArray[np.bool_]) -> float:
    return decibels(float(np.mean((image[where] - truth[where]) ** 2)))


def _moving(frame: Frame, display: Size) -> NDArray[np.bool_]:
    """(H, W) what moves in a frame, and pixels around it."""
    moves = np.abs(np.asarray(frame.motion, np.float32)).max(-1) > 1e-4
    if not moves.any():
        return np.zeros(display[::-1], bool)
    rows, columns = (np.arange(display[axis]) * frame.size[axis] // display[axis] for axis in (1, 0))
    wide = np.pad(moves[rows][:, columns], _REACH).astype(np.int32).cumsum(0).cumsum(1)
    sums = np.pad(wide, ((1, 0), (1, 0)))
    side = 2 * _REACH + 1
    found: NDArray[np.bool_] = (
        sums[side:, side:] - sums[:-side, side:] - sums[side:, :-side] + sums[:-side, :-side] > 0
    )
    return found


def _source(scene: str, display: Size, ratio: float, samples: int) -> Source:
    size, moves = render_size(display, ratio), scene.endswith(MOVER)
    if scene.startswith("analytic"):
        analytic: Scene = still_scene_with_mover() if moves else still_scene()
        return (
            lambda index: analytic.frame(index, size, halton_jitter(index, ratio)),
            lambda index: analytic.truth(index, display),
        )
    renderer, family = Renderer(display, samples=samples), scene.removesuffix(MOVER)
    spec = SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=frame_count(ratio))
    sequence = HeldSequence(spec, HELD_FRAME, time_stands=not moves)
    return (
        lambda index: rendered_frame(renderer, sequence.scene(index), size, halton_jitter(index, ratio)),
        lambda index: renderer.reference(sequence.scene(index)).color,
    )


def still_record(results: Sequence[StillScores], display: Size, executor: str, skip: Skip) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "still",
        "display": list(display),
        "executor": executor,
        "skip": skip,
        "periods": list(PERIODS),
        "scores": [asdict(r) for r in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    after = [f"after {n}:" for n in record["periods"]]
    rows = [
        [
            r.scene,
            f"{r.ratio:g}",
            r.method,
            *(figure(value, 1) for value in r.psnr),
            figure(r.best, 1),
            figure(r.best - r.psnr[-1], 1),
            figure(r.flicker, 4),
            figure(r.share, 2),
        ]
        for r in (StillScores(**row) for row in record["scores"])
    ]
    caption = (
        f"PSNR, dB, of {size_text(record['display'])} after jitter periods in front of a fixed camera, "
        f"`{record['executor']}`, skip {record['skip']}: where nothing moved. "
        "Best mean: of the same samples, offline. "
        f"{machine_name(record)}."
    )
    headings = ["scene", "ratio:", "method", *after, "best mean:", "to it:", "flicker:", "share of a step:"]
    return table(headings, rows, caption)
