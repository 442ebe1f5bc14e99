"""Pass 4, create locks, and their update in pass 5. Locked pixels, of thin features, skip rectification.

A lock is (lifetime, luma). A lifetime of 0 is no lock, one above 1 an active lock. The luma is the shading's
at the time of the lock.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import View, lerp, saturate
from supersampler_bench.fsr2.color import perceived_luma, prepared, tonemap
from supersampler_bench.fsr2.sampling import centres, neighbours

Bool = NDArray[np.bool_]
UPSAMPLE_WEIGHT_SCALE = 1.0 / 12.0
"""fUpsampleLanczosWeightScale."""
_AVERAGE_WEIGHT = 0.74 * UPSAMPLE_WEIGHT_SCALE  # that one frame adds to a pixel
_SIMILAR = 1.05  # quotient of lumas below which neighbours belong together
_CORNERS = (
    ((-1, -1), (0, -1), (-1, 0)),
    ((0, -1), (1, -1), (1, 0)),
    ((-1, 0), (-1, 1), (0, 1)),
    ((1, 0), (0, 1), (1, 1)),
)


def lock_luma(color: Array, exposure: float) -> Array:
    """Return the luma (h, w) that locks compare: the sixth root of the perceived one."""
    return np.power(perceived_luma(tonemap(prepared(color, exposure))), np.float32(1.0 / 6.0))


def thin_features(luma: Array) -> Bool:
    """Return where a pixel is a ridge: above or below all unlike neighbours, and in no 2x2 of like ones."""
    like, least, most = {}, np.full_like(luma, np.inf), np.zeros_like(luma)
    for offset, other in neighbours(luma):
        if offset == (0, 0):
            continue
        low, high = np.minimum(luma, other), np.maximum(luma, other)
        like[offset] = (low > 0.0) & (high < _SIMILAR * low)
        least = np.where(like[offset], least, np.minimum(least, other))
        most = np.where(like[offset], most, np.maximum(most, other))
    thick = np.logical_or.reduce([np.logical_and.reduce([like[o] for o in corner]) for corner in _CORNERS])
    return np.asarray(((luma > most) | (luma < least)) & ~thick)


def new_locks(luma: Array, view: View) -> Bool:
    """Return the display pixels (H, W) that the samples of thin features fell into."""
    width, height = view.display
    locked = np.zeros((height, width), bool)
    rows, columns = np.nonzero(thin_features(luma))
    x, y = (centre.ravel() for centre in centres(view.render))
    column = np.floor((x[columns] + view.jitter[0]) * view.upscale[0]).astype(np.int64)
    row = np.floor((y[rows] + view.jitter[1]) * view.upscale[1]).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    locked[row[inside], column[inside]] = True
    return locked


class LockUpdate(NamedTuple):
    """Locks after this frame's shading, (H, W) each.

    Attributes:
        lifetime: of the lock.
        luma: of the lock.
        contribution: how far the history is to be kept from rectification.
        change: of the shading, 0 to 1.
        reactive: the reactive factor, raised where the shading changed.
    """

    lifetime: Array
    luma: Array
    contribution: Array
    change: Array
    reactive: Array


def update_locks(
    locks: Array, made: Bool, shading: Array, reactive: Array, mask: Array, disoccluded: Array
) -> LockUpdate:
    """Update the reprojected locks (H, W, 2) by new ones and by the shading; all (H, W)."""
    lifetime, kept = locks[..., 0], locks[..., 1]
    before = np.where(kept == 0.0, shading, kept)
    change = 1.0 - _min_over_max(before, shading)
    weak = lifetime <= 1.0
    luma = np.where(made, shading, np.where(weak, lerp(before, shading, 0.5), before))
    again = np.where(lifetime != 0.0, np.float32(2.0), np.float32(1.0))
    held = np.where(weak | (change <= 0.1), lifetime, np.float32(0.0))
    lifetime = np.where(made, again, held)
    reactive = np.maximum(reactive, saturate((change - 0.1) * 10.0))
    lifetime = lifetime * (1.0 - reactive) * saturate(1.0 - mask) * (disoccluded < 0.1)
    contribution = saturate(saturate(lifetime - 1.0) * 4.0) * saturate(_min_over_max(luma, shading))
    return LockUpdate(lifetime, luma, contribution, change, reactive)


def aged(update: LockUpdate, weight: Array, stays: Bool, view: View) -> Array:
    """Return the locks (H, W, 2) for the next frame; those about to leave the screen end."""
    phases = jitter_phase_count(view.display[0] / view.render[0])
    older = np.maximum(update.lifetime - weight / np.float32(phases * _AVERAGE_WEIGHT), 0.0)
    return np.stack([np.where(stays, older, np.float32(0.0)), update.luma], axis=-1)


def _min_over_max(a: Array, b: Array) -> Array:
    least, most = np.minimum(a, b), np.maximum(a, b)
    return np.where(most != 0.0, least / np.where(most != 0.0, most, np.float32(1.0)), np.float32(0.0))
