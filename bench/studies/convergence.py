"""Prototype of step 10: means of a still scene's samples beside a method's images, and when they reopen.

Two ways to add up samples: `mean`, what the step of a method can do without knowing the jitter sequence
(N' = N + W, c += W / N' (u - c), W a Gaussian within a tent); `tiles`, the weights of static tiles.
    python bench/studies/convergence.py --ratio 2
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray

from supersampler import Frame, Upscaler, halton_jitter
from supersampler.backends.cpu.static_weights import NONE, StaticWeights
from supersampler.conventions import jitter_phase_count
from supersampler.conventions.srgb import srgb_encoded
from supersampler.frame import Float32, Size
from supersampler.io.display import decibels, display_transform
from supersampler_bench.cli.options import listed
from supersampler_model.data.scenes.still_life import still_scene

DISPLAY: Size = (320, 180)
SIGMA = 0.35
"""Of the Gaussian of `mean`, display pixels."""
CHANGE = 8.0 / 255.0
BLOCK = 16
PLACES = {"waves": (40, 80), "rings": (150, 90), "checks": (270, 40), "line": (280, 130)}
"""Upper left corners, display pixels, of blocks that change."""


@dataclass
class Mean:
    """Samples since the scene stands still; all (H, W, ...) float32, linear RGB."""

    color: Float32
    mass: Float32
    square: Float32

    @classmethod
    def zeros(cls, display: Size) -> "Mean":
        """Return the mean of nothing."""
        color, one = np.zeros((*display[::-1], 3), np.float32), np.zeros((*display[::-1], 1), np.float32)
        return cls(color, one, one.copy())

    def add(self, color: Float32, weight: Float32) -> None:
        """Add samples by the recursion; `square` sums squared distances (West 1979)."""
        before = color - self.color
        self.mass += weight
        self.color += weight / np.maximum(self.mass, 1e-6) * before
        self.square += weight * (before * (color - self.color)).mean(-1, keepdims=True)

    def variance(self, left: float | None) -> Float32:
        """Return that of the mean; large where there are hardly samples.

        Args:
            left: part of the period's samples that are not in yet: those of a period are taken without
                replacement. None where the period is not known: jitter spreads samples evenly, so that the
                error shrinks with their number, not with its root.
        """
        sure, mass = self.mass > 1.0, np.maximum(self.mass, 1e-6)
        spread = self.square / (mass * mass) * (1.0 / mass if left is None else left)
        return np.where(sure, spread, np.float32(1e3)).astype(np.float32)


def nearby(frame: Frame, display: Size) -> tuple[Float32, Float32]:
    """Return the mean of the samples near each pixel under a Gaussian within a tent, and its weight."""
    color = np.asarray(frame.color, np.float32)
    axes = []
    for axis in (1, 0):
        n, m, j = display[axis], frame.size[axis], frame.jitter[axis]
        away = np.arange(n)[:, None] + 0.5 - (np.arange(m) + 0.5 + j) * (n / m)
        axes.append(np.exp(-0.5 * (away / SIGMA) ** 2) * np.maximum(1.0 - np.abs(away), 0.0))
    rows, columns = axes
    weight = rows.sum(1)[:, None] * columns.sum(1)
    total = np.stack([rows @ color[..., c] @ columns.T for c in range(3)], axis=-1)
    mean = total / np.maximum(weight, 1e-9)[..., None]
    return mean.astype(np.float32), weight[..., None].astype(np.float32)


def inside(frame: Frame, weights: StaticWeights, phase: int) -> tuple[Float32, Float32]:
    """Return the sample in each pixel, and its weight in the mean of a period, in units of its share."""
    rows, columns = (np.maximum(axis.sample[phase], 0) for axis in (weights.rows, weights.columns))
    count = (weights.rows.sample != NONE).astype(float).T @ (weights.columns.sample != NONE)
    color: Float32 = np.asarray(frame.color, np.float32)[rows][:, columns]
    share: Float32 = (weights.of_frame(phase) * count)[..., None].astype(np.float32)
    return color, share


def blurred(values: NDArray[np.floating], reach: int) -> Float32:
    """Return means over (2 reach + 1)^2 pixels, (H, W, 1)."""
    wide = np.pad(values[..., 0], ((reach + 1, reach), (reach + 1, reach)), mode="edge").cumsum(0).cumsum(1)
    side = 2 * reach + 1
    total = wide[side:, side:] - wide[:-side, side:] - wide[side:, :-side] + wide[:-side, :-side]
    mean: Float32 = (total / side**2).astype(np.float32)[..., None]
    return mean


def crossfaded(image: Float32, mean: Mean, left: float | None) -> Float32:
    """Return the method's image faded to the mean by the variance of each.

    The variance of the image is what it differs from the mean by beyond the mean's own variance.
    """
    own = mean.variance(left)
    apart = ((image - mean.color) ** 2).mean(-1, keepdims=True)
    other = np.maximum(blurred(apart - own, 3), 0.0)
    part = (mean.mass > 0) * (other + 1e-7) / (other + 1e-7 + own)
    return (image + part * (mean.color - image)).astype(np.float32)


def convergence(method: str, kind: str, ratio: float, periods: int) -> str:
    """Return a row: PSNR after 1, 2, ... periods, flicker of the last, the largest step between frames."""
    scene, size = still_scene(), (round(DISPLAY[0] / ratio), round(DISPLAY[1] / ratio))
    count = jitter_phase_count(ratio)
    jitter = [halton_jitter(i, ratio) for i in range(count)]
    weights, truth = StaticWeights(DISPLAY, size, jitter), display_transform(scene.truth(0, DISPLAY))
    upscaler = Upscaler(method, display_size=DISPLAY, skip="exact", validate="off", threads=1)
    mean, scores, steps = Mean.zeros(DISPLAY), list[float](), list[float]()
    shown: list[Float32] = []
    before: Float32 | None = None
    frames = [scene.frame(1, size, place) for place in jitter]
    for index in range(periods * count):
        frame = frames[index % count]
        image = upscaler.step(frame)
        if kind != "none":
            sample = nearby(frame, DISPLAY) if kind == "mean" else inside(frame, weights, index % count)
            mean.add(*sample)
            left = None if kind == "mean" else max(0.0, 1.0 - (index + 1) / count)
            image = crossfaded(image, mean, left)
        toned = display_transform(image)
        scores.append(decibels(float(np.mean((toned - truth) ** 2))))
        steps.append(0.0 if before is None else float(np.abs(toned - before).mean()))
        before = toned
        shown = [*shown[-count + 1 :], toned]
    curve = " ".join(f"{scores[i]:.1f}" for i in (count // 8, count // 4, count // 2))
    after = " ".join(f"{scores[(2**k) * count - 1]:.1f}" for k in range(3) if 2**k <= periods)
    return (
        f"{method:17} {kind:6} {ratio:<4g} in period 1: {curve}; after 1, 2, 4: {after}; "
        f"flicker {np.std(shown, axis=0).mean():.5f}; largest step from frame {count // 4} on "
        f"{max(steps[count // 4 :]):.4f}"
    )


class Opening:
    """Ranges, over a period, of what a sample differs from the mean by: of each, and of 5x5 around."""

    def __init__(self, size: Size) -> None:
        shape = (2, *size[::-1], 1)
        self.low, self.high = np.full(shape, np.inf, np.float32), np.full(shape, -np.inf, np.float32)

    def measure(self, frame: Frame, mean: Mean) -> Float32:
        """Return both differences at a frame's samples, toned luma: (2, h, w, 1)."""
        axes = []
        for axis in (1, 0):
            n, m, j = mean.color.shape[1 - axis], frame.size[axis], frame.jitter[axis]
            place = (np.arange(m) + 0.5 + j) * (n / m) - 0.5
            axes.append(np.maximum(1.0 - np.abs(place[:, None] - np.arange(n)), 0.0))
        there = np.stack([axes[0] @ mean.color[..., c] @ axes[1].T for c in range(3)], axis=-1)
        color = np.asarray(frame.color, np.float32)
        apart = (toned_luma(color) - toned_luma(there.astype(np.float32)))[..., None]
        return np.stack([apart, blurred(apart, 2)])

    def add(self, apart: Float32) -> None:
        """Widen the ranges."""
        self.low, self.high = np.minimum(self.low, apart), np.maximum(self.high, apart)

    def opens(self, apart: Float32, margin: float) -> NDArray[np.bool_]:
        """(2, h, w) where a difference is out of its range."""
        return ((apart < self.low - margin) | (apart > self.high + margin))[..., 0]


def toned_luma(color: Float32) -> Float32:
    """Return luma of what a screen shows."""
    toned = color / (1.0 + color.max(-1, keepdims=True))
    luma: Float32 = srgb_encoded(toned) @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    return luma


def reopening(ratio: float, learned: int = 2) -> list[str]:
    """Return rows: how many samples of a changed block open in the first frames, and false alarms."""
    scene, size = still_scene(), (round(DISPLAY[0] / ratio), round(DISPLAY[1] / ratio))
    count = jitter_phase_count(ratio)
    frames = [scene.frame(1, size, halton_jitter(i, ratio)) for i in range(count)]
    mean, opening = Mean.zeros(DISPLAY), Opening(size)
    for period in range(learned + 1):
        for frame in frames:
            mean.add(*nearby(frame, DISPLAY))
            if period == learned:
                opening.add(opening.measure(frame, mean))
    rows, margin = [], 1.0 / 255.0
    false = np.mean([opening.opens(opening.measure(frame, mean), margin).any(0).mean() for frame in frames])
    for name, (x, y) in PLACES.items():
        place = tuple(slice(int(v / ratio), int((v + BLOCK) / ratio)) for v in (y, x))
        single, mean_of_5x5, latency = [], [], []
        for start in range(count):
            opened = []
            for frame in (frames[(start + k) % count] for k in range(4)):
                color = np.array(frame.color)
                color[place] = brighter(color[place])
                changed = Frame(
                    color=color, depth=frame.depth, motion=frame.motion, jitter=frame.jitter, exposure=1.0
                )
                opened.append(opening.opens(opening.measure(changed, mean), margin)[(slice(None), *place)])
            single.append(opened[0][0].mean())
            mean_of_5x5.append(opened[0].any(0).mean())
            latency.append(next((k + 1 for k, o in enumerate(opened) if o.any(0).mean() > 0.1), 5))
        rows.append(
            f"{name:7} first frame: own sample {np.mean(single):.2f}, or 5x5 {np.mean(mean_of_5x5):.2f}; "
            f"frames until a tenth is open, worst phase: {max(latency)}"
        )
    return [*rows, f"false alarms of samples, a frame: {false:.5f}"]


def brighter(color: Float32) -> Float32:
    """Return colours that a screen shows CHANGE brighter."""
    toned = color / (1.0 + color.max(-1, keepdims=True))
    shown = np.clip(srgb_encoded(toned) + CHANGE, 0.0, 0.99)
    linear = np.where(shown <= 0.04045, shown / 12.92, ((shown + 0.055) / 1.055) ** 2.4)
    found: Float32 = (linear / (1.0 - linear.max(-1, keepdims=True))).astype(np.float32)
    return found


def main(
    ratio: Annotated[str, typer.Option(help="With commas between.")] = "2",
    methods: Annotated[str, typer.Option()] = "taau,classifier,classifier-small",
    periods: Annotated[int, typer.Option(min=1)] = 4,
) -> None:
    """Print what both means would give, and how soon changes are seen."""
    for value in map(float, listed(ratio)):
        for method in listed(methods):
            for kind in ("none", "mean", "tiles"):
                print(convergence(method, kind, value, periods), flush=True)
        print(*reopening(value), sep="\n", flush=True)


if __name__ == "__main__":
    typer.run(main)
