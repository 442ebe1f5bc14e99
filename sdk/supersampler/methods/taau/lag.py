"""Lag of the history where light changes and nothing moves: twin of `supersampler_model.methods.taau.lag`."""

from collections.abc import Mapping

import numpy as np

from supersampler.backends.cpu.at_rest import Stillness, nearest_pixels, spread, windowed
from supersampler.frame import Float32
from supersampler.methods.at_rest import BLOCK, DARK, WINDOWS
from supersampler.methods.taau.spec import LAG_STEP, LEAST_BLOCKS, MOST_SAMPLES


def samples_kept(
    toned: Float32,
    usable: Float32,
    pixels: Float32,
    exposure: float,
    still: Stillness,
    config: Mapping[str, float],
) -> Float32 | None:
    """Return the number of samples of the history that are kept, (down, across) blocks; None if all are.

    Args:
        toned: (h, 3, w) toned RGB of this frame.
        usable: (h, w) 1 where a sample counts, else 0.
        pixels: (H, W, >= 3) the history, linear RGB first.
        exposure: of this frame.
        still: what stands still.
        config: constants of the model.
    """
    free = ~still.moves & ~still.stays
    if not free.any():
        return None
    (height, _, width), side = toned.shape, WINDOWS[1]
    columns, rows = nearest_pixels(pixels.shape[1::-1], (width, height))
    before = pixels[rows[::LAG_STEP, None], columns[::LAG_STEP], :3] * np.float32(exposure)
    before = (before / (1.0 + before.max(axis=2, keepdims=True))).transpose(2, 0, 1)
    now, counts = toned[::LAG_STEP, :, ::LAG_STEP].transpose(1, 0, 2), usable[::LAG_STEP, ::LAG_STEP]
    parts = windowed(np.concatenate([now - before, before]) * counts, BLOCK // LAG_STEP)
    difference, level = parts.reshape(2, 3, *free.shape) / np.float32((BLOCK // LAG_STEP) ** 2)
    sums = windowed(np.concatenate([difference, np.square(difference), level, free[None]]) * free, side)
    count = sums[9]
    difference, square, level = sums[:9].reshape(3, 3, *count.shape) / np.maximum(count, 1.0)
    variance = np.maximum(square - np.square(difference), 0.0)
    error = np.sqrt(variance / np.maximum(count - 1.0, 1.0))
    lag = (np.abs(difference) - config["lag_deviations"] * error).max(axis=0)
    excess = lag / (level.max(axis=0) + DARK) - config["lag"]
    kept = config["lag_samples"] / np.maximum(excess, config["lag_samples"] / MOST_SAMPLES)
    kept = spread(np.where(count >= LEAST_BLOCKS * side * side, kept, MOST_SAMPLES), side, free.shape)
    kept = np.where(free, kept, MOST_SAMPLES).astype(np.float32)
    return kept if (kept < MOST_SAMPLES).any() else None
