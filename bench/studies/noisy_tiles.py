"""Study: how far an image by skip="accumulate" falls behind light that changes, below noise.

    python bench/studies/noisy_tiles.py [SEEDS]

A grey wall under Gaussian noise of 4 samples a pixel accumulates for 512 frames at 60 a second. Then (a) all
light fades by 1 % a second for ten seconds, (b) the edge of a shadow creeps by a pixel in eight frames, (c) a
lamp doubles the light of one corner. Printed: the largest lag of tile means over all seeds; the bounds that
skip="auto" would have to keep are 2/255, 8 frames and 1 frame.
"""

import sys
from collections.abc import Callable

import numpy as np

from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform

WIDTH, HEIGHT, RATIO, WARM = 128, 64, 2.0, 512
NOISE = 0.5  # standard deviation of one sample, as a part of the light
Light = Callable[[int, Float32], Float32]
"""Light at columns of the display, in a frame since the change."""


def frame(index: int, light: Light, rng: np.random.Generator, samples: int) -> Frame:
    """One frame of the wall; index 0 is the first one of the change."""
    w, h = int(WIDTH / RATIO), int(HEIGHT / RATIO)
    jitter = halton_jitter(index + WARM, RATIO)
    x = ((np.arange(w) + 0.5 + jitter[0]) * RATIO).astype(np.float32)
    level = np.broadcast_to(0.5 * light(index, x), (h, w))[..., None]
    noise = rng.normal(1.0, NOISE / np.sqrt(samples), (h, w, 1))
    color = np.repeat(np.maximum(level * noise, 0.0), 3, axis=2).astype(np.float32)
    depth, motion = np.full((h, w), 0.1, np.float32), np.zeros((h, w, 2), np.float32)
    return Frame(color=color, depth=depth, motion=motion, jitter=jitter, exposure=1.0)


def means(model: Model, light: Light, frames: int, seed: int, samples: int = 4) -> Float32:
    """Display values of the tiles' means in each frame since the change: (frames, columns of tiles)."""
    rng, found = np.random.default_rng(seed), []
    upscaler = Upscaler(model, display_size=(WIDTH, HEIGHT), skip="accumulate", validate="off")
    for index in range(-WARM, frames):
        image = upscaler.step(frame(index, light, rng, samples))
        if index >= 0:
            found.append(image.reshape(HEIGHT, WIDTH // 8, 8, 3).mean((0, 2)))
    return display_transform(np.array(found, np.float32), 1.0)[..., 0]


def true_means(light: Light, frames: int) -> Float32:
    """What `means` would be without noise and lag."""
    x = np.arange(WIDTH * 4, dtype=np.float32) / 4.0 + 0.125
    level = np.stack([0.5 * np.broadcast_to(light(k, x), x.shape) for k in range(frames)])
    mean = level.reshape(frames, WIDTH // 8, 32).mean(-1).astype(np.float32)
    return display_transform(np.repeat(mean[..., None], 3, -1), 1.0)[..., 0]


def fade(k: int, x: Float32) -> Float32:
    """All light, 1 % less a second."""
    return np.full_like(x, 1.0 - 0.01 * max(k, 0) / 60.0)


def shadow(k: int, x: Float32) -> Float32:
    """A shadow of half the light left of an edge that creeps to the right."""
    return np.where(x < 32.0 + max(k, 0) / 8.0, 0.5, 1.0).astype(np.float32)


def lamp(k: int, x: Float32) -> Float32:
    """A lamp that is turned on."""
    return np.where((x < 32.0) & (k >= 0), 2.0, 1.0).astype(np.float32)


def main(seeds: int) -> None:
    """Print the three lags."""
    model = Model.load("taau", executor="cpu")

    def over_seeds(light: Light, frames: int) -> Float32:
        total: Float32 = np.mean([means(model, light, frames, seed) for seed in range(seeds)], axis=0)
        return total

    behind = np.abs(over_seeds(fade, 600) - true_means(fade, 600)).max()
    print(f"fade: at most {behind * 255.0:.2f}/255 behind")
    creeping, true = over_seeds(shadow, 256), true_means(shadow, 256)
    lag = np.abs(creeping - true) / (np.ptp(true) / (8 * 8))  # the edge passes a tile in 64 frames
    print(f"shadow: at most {lag.max():.1f} frames behind")
    shown, true = over_seeds(lamp, 16), true_means(lamp, 16)
    error = np.abs(shown - true)[:, :4].max(1) / np.ptp(true)
    print("lamp: missing part of its light by frame:", " ".join(f"{part:.2f}" for part in error))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 32)
