"""Lag of the accumulated samples behind light that changes while nothing moves.

The variance box does not find it on textured ground: colours that light has left are still in the box. But
the samples of a window have the mean of the history there, whatever its texture. Where these differ by more
than the differences within the window explain, few samples of the history are kept.
"""

import torch
from torch import Tensor

from supersampler.methods.at_rest import BLOCK, DARK, WINDOWS
from supersampler.methods.taau.spec import LAG_STEP, LEAST_BLOCKS, MOST_SAMPLES, TaauConfig
from supersampler_model.ops.at_rest import Stillness
from supersampler_model.ops.color import tone
from supersampler_model.ops.size import render_size_of
from supersampler_model.ops.windows import cut, means_of, spread


def samples_kept(
    color: Tensor, usable: Tensor, history: Tensor, still: Stillness, config: TaauConfig
) -> Tensor:
    """Return the number of samples of the history that are kept, by block, (1, 1, hb, wb).

    Of each block that neither moves nor stays frozen, some samples are compared with the nearest
    pixels of the history, toned. Windows of such blocks have a mean difference, and its standard error.

    Args:
        color: (1, 3, h, w) this frame, exposed; finite.
        usable: (1, 1, h, w) 1 where a sample counts, else 0.
        history: (1, 3, H, W) colours of the history, exposed.
        still: what stands still.
        config: constants.
    """
    columns, rows = still.at_pixels.nearest(LAG_STEP)
    before = tone(history.index_select(3, columns).index_select(2, rows))
    now = tone(color[:, :, ::LAG_STEP, ::LAG_STEP])
    free = (1.0 - still.moves) * (1.0 - still.stays)
    size, side = render_size_of(free), WINDOWS[1]
    parts = torch.cat([now - before, before], dim=1) * usable[:, :, ::LAG_STEP, ::LAG_STEP]
    parts = cut(cut(parts, 2, size.height * BLOCK // LAG_STEP), 3, size.width * BLOCK // LAG_STEP)
    difference, level = means_of(parts, BLOCK // LAG_STEP).split_with_sizes([3, 3], dim=1)
    values = torch.cat([difference, difference * difference, level, torch.ones_like(free)], dim=1) * free
    sums = spread(means_of(extended(values, side - 1), side), side, size)
    difference, square, level, share = sums.split_with_sizes([3, 3, 3, 1], dim=1)
    difference, square, level = (part / share.clamp(min=1e-6) for part in (difference, square, level))
    variance = (square - difference * difference).clamp(min=0.0)
    error = (variance / (share * side * side - 1.0).clamp(min=1.0)).sqrt()
    lag = (difference.abs() - config.lag_deviations * error).amax(dim=1, keepdim=True)
    excess = lag / (level.amax(dim=1, keepdim=True) + DARK) - config.lag
    fewest = config.lag_samples / excess.clamp(min=config.lag_samples / MOST_SAMPLES)
    return torch.where(free * (share >= LEAST_BLOCKS) > 0.0, fewest, MOST_SAMPLES)


def extended(blocks: Tensor, count: int) -> Tensor:
    """Append so many rows and columns of zeros."""
    height, width = blocks.shape[2:]
    down, across = (
        (torch.arange(extent + count, device=blocks.device) < extent).float() for extent in (height, width)
    )
    return cut(cut(blocks, 2, height + count), 3, width + count) * down[:, None] * across
