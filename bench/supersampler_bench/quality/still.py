"""Convergence of methods to the reference in scenes with a fixed camera."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from supersampler import Model, Upscaler, halton_jitter
from supersampler.arguments import ExecutorName
from supersampler.cli.arguments import size_text
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import display_transform
from supersampler_bench.quality.masks import dilated
from supersampler_bench.quality.metrics import Bool, psnr
from supersampler_bench.record import BenchRecord, figure, table
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendering import held_sequence, rendered_frame
from supersampler_model.data.rendered import render_size
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.analytic import AnalyticScene, still_scene, still_scene_with_mover

PERIODS = (1, 2, 4)
"""Jitter periods after which images are scored; a scene ends after the last."""
MOVER = "-mover"
SCENES = tuple(f"{name}{end}" for name in ("analytic", *TEST_SHOTS.seeds) for end in ("", MOVER))
"""The analytic scene, and test shots with a fixed camera. Objects move where the name ends in MOVER."""
_REACH = 4  # display pixels around changes, which are not scored
_UNCHANGED = 1.0 / 255.0  # maximum change of a static sample, display values


@dataclass(frozen=True)
class StillScores:
    """Scores of a method in a scene, over the pixels that never change."""

    scene: str  # one of SCENES
    ratio: float
    method: str
    executor: str  # "cpu" or "onnx"
    scored: float  # fraction of the pixels that never change
    psnr: list[float]  # dB of each frame
    flicker: float  # mean over pixels of the standard deviation of display values in the last period

    def after(self, periods: int) -> float:
        """Return the mean PSNR, dB, over the quarter period that ends after `periods` jitter periods."""
        count = jitter_phase_count(self.ratio)
        return float(np.mean(self.psnr[periods * count - max(count // 4, 1) : periods * count]))


@dataclass(frozen=True)
class StillScene:
    """A scene with a fixed camera."""

    frames: list[Frame]  # of PERIODS[-1] jitter periods
    truth: Float32  # (H, W, 3) reference of the last frame, display values
    still: Bool  # (H, W) pixels that never change


def frame_count(ratio: float) -> int:
    """Return the number of frames of a scene."""
    return PERIODS[-1] * jitter_phase_count(ratio)


def measure_still(
    scenes: Sequence[tuple[str, float]],
    methods: Sequence[str],
    display: Size,
    *,
    executors: Sequence[ExecutorName] = ("cpu", "onnx"),
    samples: int = 64,
    on_frame: Callable[[], None] = lambda: None,
) -> list[StillScores]:
    """Step methods through some of SCENES, each with a ratio; references have `samples` samples per pixel."""
    kinds = [(method, executor) for method in methods for executor in executors]
    models = {kind: Model.load(kind[0], providers="cpu", executor=kind[1]) for kind in kinds}
    results = []
    for name, ratio in scenes:
        scene = make_scene(name, display, ratio, samples)
        runs = [_StillRun(*kind, model, scene) for kind, model in models.items()]
        for frame in scene.frames:
            for run in runs:
                run.step(frame)
            on_frame()
        results += [run.scores(name, ratio) for run in runs]
    return results


class _StillRun:
    """One method in one scene."""

    def __init__(self, method: str, executor: ExecutorName, model: Model, scene: StillScene) -> None:
        self._method, self._executor, self._scene = method, executor, scene
        height, width, _ = scene.truth.shape
        self._upscaler = Upscaler(model, display_size=(width, height), validate="off")
        self._image = np.empty_like(scene.truth)
        self._psnr: list[float] = []
        self._sums = np.zeros((2, *scene.truth.shape))  # display values and their squares, last period

    def step(self, frame: Frame) -> None:
        self._upscaler.step(frame, out=self._image)
        shown = display_transform(self._image, frame.exposure or 1.0)
        self._psnr.append(psnr(shown, self._scene.truth, self._scene.still))
        if len(self._psnr) > len(self._scene.frames) * (PERIODS[-1] - 1) // PERIODS[-1]:
            self._sums += shown, np.square(shown, dtype=np.float64)

    def scores(self, scene: str, ratio: float) -> StillScores:
        period = jitter_phase_count(ratio)
        mean, square = self._sums / period
        deviation = np.sqrt(np.maximum(square - mean * mean, 0.0))
        return StillScores(
            scene=scene,
            ratio=ratio,
            method=self._method,
            executor=self._executor,
            scored=float(self._scene.still.mean()),
            psnr=[round(value, 2) for value in self._psnr],
            flicker=float(deviation[self._scene.still].mean()),
        )


def make_scene(name: str, display: Size, ratio: float, samples: int) -> StillScene:
    """Render one of SCENES, with `samples` samples per pixel of a test shot's reference."""
    size, moves, count = render_size(display, ratio), name.endswith(MOVER), frame_count(ratio)
    jitter = [halton_jitter(index, ratio) for index in range(count)]
    if name.startswith("analytic"):
        analytic: AnalyticScene = still_scene_with_mover() if moves else still_scene()
        frames = [analytic.frame(index, size, jitter[index]) for index in range(count)]
        truth = analytic.truth(count - 1, display)
    else:
        renderer, family = Renderer(display, samples=samples), name.removesuffix(MOVER)
        sequence = held_sequence(family, count, time_stands=not moves)
        frames = [rendered_frame(renderer, sequence.scene(i), size, jitter[i]) for i in range(count)]
        truth = renderer.reference(sequence.scene(count - 1)).color
    shown = display_transform(truth, frames[-1].exposure or 1.0)
    return StillScene(frames, shown, _still(frames, display))


def _still(frames: Sequence[Frame], display: Size) -> Bool:
    """Return the pixels (H, W) near which every sample equals the one of the previous jitter period."""
    period = len(frames) // PERIODS[-1]
    colors = [display_transform(np.asarray(frame.color), frame.exposure or 1.0) for frame in frames]
    changes = np.zeros(colors[0].shape[:2], bool)
    for color, before in zip(colors[period:], colors, strict=False):
        changes |= np.abs(color - before).max(-1) > _UNCHANGED
    rows, columns = (np.arange(display[i]) * changes.shape[1 - i] // display[i] for i in (1, 0))
    return ~dilated(changes[rows][:, columns], _REACH)


@dataclass(frozen=True)
class StillRecord(BenchRecord):
    """Scores of methods in scenes, at a display size."""

    display: Size
    scores: list[StillScores]
    BENCH = "still"
    TABLES = ("", "summary")

    def scores_at_one_ratio(self) -> list[StillScores]:
        """Return the scores at the ratio closest to 2, which summary and figure show."""
        ratio = min((score.ratio for score in self.scores), key=lambda value: abs(value - 2.0))
        return [score for score in self.scores if score.ratio == ratio]

    def table(self) -> str:
        """Return the table of all scores."""
        rows = [
            [
                *(score.scene, f"{score.ratio:g}", score.method, score.executor),
                figure(100.0 * score.scored, 0, " %"),
                *(figure(score.after(count), 1) for count in PERIODS),
                figure(score.flicker, 4),
            ]
            for score in self.scores
        ]
        periods = [f"PSNR dB, {count}:" for count in PERIODS]
        caption = (
            f"Images of {size_text(self.display)}, over the pixels that never change: PSNR after 1, 2 and 4 "
            f"jitter periods; flicker within the last period. {self.machine_name}."
        )
        return table(["scene", "ratio:", "method", "backend", "pixels:", *periods, "flicker:"], rows, caption)

    def summary_table(self) -> str:
        """Return a table with a row for each method and backend, of all scenes at one ratio."""
        shown = self.scores_at_one_ratio()
        scenes = list(dict.fromkeys(score.scene for score in shown))
        rows = []
        for method, executor in dict.fromkeys((score.method, score.executor) for score in shown):
            first, *others = [s for s in shown if (s.method, s.executor) == (method, executor)]
            scores = [first.after(count) for count in PERIODS] + [s.after(PERIODS[-1]) for s in others]
            rows.append([method, executor, *(figure(score, 1) for score in scores)])
        headings = [
            *("method", "backend"),
            *(f"{scenes[0]}, {count} period{'s' * (count > 1)}:" for count in PERIODS),
            *(f"{scene}, {PERIODS[-1]}:" for scene in scenes[1:]),
        ]
        caption = (
            f"PSNR, dB, after 1, 2 and 4 jitter periods at ratio {shown[0].ratio:g}, over the pixels that "
            f"never change; images of {size_text(self.display)}. {self.machine_name}."
        )
        return table(headings, rows, caption)
