"""Lag of the history where light changes and nothing moves: twin of `supersampler_model.methods.taau`."""

from collections.abc import Mapping

import numpy as np

from supersampler.backends.cpu.at_rest import Stillness, spread, windowed, windows_around
from supersampler.backends.cpu.tiles import Bool
from supersampler.frame import Float32
from supersampler.methods.at_rest import BLOCK, DARK, WINDOWS
from supersampler.methods.taau.spec import LAG_STEP, LEAST_BLOCKS, MOST_SAMPLES


def compared(still: Stillness) -> Bool:
    """Return the blocks that are compared with the history, (down, across)."""
    return ~still.moves & ~still.stays


def samples_kept(sums: Float32, still: Stillness, config: Mapping[str, float]) -> Float32 | None:
    """Return the number of samples of the history that are kept, (down, across) blocks; None if all are.

    Args:
        sums: (6, down, across) by the kernel `compare_with_history`.
        still: what stands still.
        config: constants of the model.
    """
    rows, columns = windows_around(compared(still))
    free, side = compared(still)[rows, columns], WINDOWS[1]
    sums = sums[:, rows, columns]
    difference, level = sums.reshape(2, 3, *free.shape) / np.float32((BLOCK // LAG_STEP) ** 2)
    values = np.concatenate([difference, np.square(difference), level, free[None]]) * free
    down, across = free.shape
    sums = windowed(np.pad(values, ((0, 0), (0, -down % side), (0, -across % side))), side)
    count = sums[9]
    difference, square, level = sums[:9].reshape(3, 3, *count.shape) / np.maximum(count, 1.0)
    variance = np.maximum(square - np.square(difference), 0.0)
    error = np.sqrt(variance / np.maximum(count - 1.0, 1.0))
    lag = (np.abs(difference) - config["lag_deviations"] * error).max(axis=0)
    excess = lag / (level.max(axis=0) + DARK) - config["lag"]
    least = config["lag_samples"] / MOST_SAMPLES
    limited = (count >= LEAST_BLOCKS * side * side) & (excess > least)
    kept = np.where(limited, config["lag_samples"] / np.maximum(excess, least), MOST_SAMPLES)
    whole = np.full(still.stays.shape, MOST_SAMPLES, np.float32)
    whole[rows, columns] = np.where(free, spread(kept, side, free.shape), MOST_SAMPLES)
    return whole if (whole < MOST_SAMPLES).any() else None
