"""Pass 3, depth clip: finds disocclusion, and diverging motion, where the history is not valid.

Separation of depths: Akeley and Su, Minimum Triangle Separation for Correct Z-Buffer Occlusion, 2006.
"""

import math
from typing import NamedTuple

import numpy as np

from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import Inputs, View, length, lerp, saturate
from supersampler_bench.fsr2.dilate import Dilated, moving, texels_around
from supersampler_bench.fsr2.sampling import bilinear, centres, neighbours

_FIELD_OF_VIEW = math.radians(60.0)  # vertical: an input of FSR2 that frames here do not have
_SEPARATION = 1.37e-5
_FAR = float(np.finfo(np.float32).eps)  # what FSR2 adds to depth so that the sky has a distance
_FULL_SIZE = math.hypot(1920.0, 1080.0)
_STILL = 0.01  # display pixels; less motion counts as none


class Clip(NamedTuple):
    """Results of the pass, (h, w) each, in [0, 1].

    Attributes:
        disoccluded: 1 where the surface was occluded in the previous frame.
        mask: 1 where motion of neighbours, or of two frames, diverges.
    """

    disoccluded: Array
    mask: Array


def depth_clip(inputs: Inputs, dilated: Dilated, previous_motion: Array, view: View) -> Clip:
    """Run the pass; `previous_motion` is the previous frame's, dilated, as `View.of_image` returns it."""
    seen = _disoccluded(dilated, view) * _is_surface(dilated.previous)
    turned = _temporal_divergence(dilated.motion, previous_motion, view) - _depth_divergence(dilated.depth)
    return Clip(seen, np.maximum(saturate(turned), _motion_divergence(inputs.motion, view)))


def _distance(depth: Array) -> Array:
    return np.float32(1.0) / (depth + np.float32(_FAR))  # only ratios of distances are used


def _disoccluded(dilated: Dilated, view: View) -> Array:
    now = _distance(dilated.depth)
    width, height = view.render
    tangent = math.tan(_FIELD_OF_VIEW / 2.0)
    corner = math.hypot(1.0, tangent, tangent * width / height)  # of its ray; the centre's is 1 long
    separation = _SEPARATION * corner * math.hypot(width, height)
    power = 1.0 + 2.0 * min(math.hypot(width, height) / _FULL_SIZE, 1.0)
    same = np.zeros_like(now)
    total = np.zeros_like(now)
    for texel in texels_around(moving(dilated.motion, view, _STILL), view):
        before = _distance(dilated.previous[texel.row, texel.column])
        behind = now - before
        counts = texel.counts & (behind > 0.0)
        required = separation * np.maximum(now, before)
        near = saturate(required / np.where(counts, behind, np.float32(1.0)))
        same += np.where(counts, np.power(near, np.float32(power)) * texel.weight, np.float32(0.0))
        total += np.where(counts, texel.weight, np.float32(0.0))
    clip = 1.0 - same / np.where(total > 0.0, total, np.float32(1.0))
    return np.where(total > 0.0, saturate(clip), np.float32(0.0))


def _is_surface(previous: Array) -> Array:
    """Return 0 where the depth of the previous frame falls by a hundredth twice downwards, else 1."""
    above, here, below = (
        _distance(np.pad(previous, ((1, 1), (0, 0)))[row : row + len(previous)]) for row in range(3)
    )
    slope = (above - here > here * 0.01) & (here - below > below * 0.01)
    return np.where(slope, np.float32(0.0), np.float32(1.0))


def _motion_divergence(motion: Array, view: View) -> Array:
    """How far the motion (render pixels) of 3x3 neighbours parts from a pixel's own, where that moves."""
    vectors = view.of_image(motion)
    fastest = length(vectors)
    moves = length(motion) > 1e-2
    convergence = np.ones_like(fastest)
    for _, other in neighbours(vectors):
        fastest = np.maximum(fastest, length(other))  # of the neighbours so far, in FSR2's order
        along = (other * vectors).sum(axis=-1) / np.where(moves, fastest * fastest, np.float32(1.0))
        convergence = np.minimum(convergence, np.where(moves, along, np.float32(1.0)))
    return saturate(1.0 - convergence) * saturate(fastest / np.float32(0.01))


def _temporal_divergence(motion: Array, previous: Array, view: View) -> Array:
    """How much slower the previous frame was, the more the faster this one is (20 display pixels: all)."""
    h, w = previous.shape[:2]
    x, y = centres(view.render)
    across = (x + motion[..., 0]) / view.render[0] * w  # the previous render size may be another one
    down = (y + motion[..., 1]) / view.render[1] * h
    before = length(bilinear(previous, across, down))
    now, speed = length(view.of_image(motion)), view.speed(motion)
    fast = speed > 1.0
    slower = 1.0 - saturate(before / np.where(fast, now, np.float32(1.0)))
    return np.where(fast, lerp(0.0, slower, saturate((speed / np.float32(20.0)) ** 3)), np.float32(0.0))


def _depth_divergence(depth: Array) -> Array:
    """1 - closest / farthest of 3x3, 1 along the border, 0 beside the sky."""
    around = np.pad(_distance(depth), 1)
    windows = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
    least, most = windows.min(axis=(2, 3)), windows.max(axis=(2, 3))
    has_sky = (windows == _distance(np.zeros(1, np.float32))).any(axis=(2, 3))
    return np.where(has_sky, np.float32(0.0), 1.0 - least / most)
