"""Pixel checks of a single frame: colour, depth, motion, exposure."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from supersampler.conventions.encodings import srgb_encoded
from supersampler.frame import Array, Float32, Frame
from supersampler.io.display import usable_exposure
from supersampler.validation import mistakes
from supersampler.validation.mistakes import Mistake, where
from supersampler.validation.probe import (
    GRID_PIXELS,
    PixelGrid,
    pixel_grid,
    plane_curvature,
    sky_fraction,
    tone_mapped,
)

_MAX_MIXED = 0.55  # maximum fraction of mixed edges in point samples; filtered colour has more
# Displayed colours, as fractions of the display's range.
_FULL = 0.9  # minimum of the brightest value
_MIDDLE = (0.3, 0.85)  # range of the median of the pixels' largest channels
_MIN_SPREAD = 0.2  # of the brightest value: minimum difference of the quantiles 0.1 and 0.9
_MIN_DEPTHS = 100  # minimum number of distinct depths; test patterns, of any colours, have fewer
_MIN_SURFACE = 1000  # minimum number of pixels that are not sky
_MAX_CHANGE = 0.5  # standard deviations: maximum mean change from pixel to pixel
_WHOLE = 0.07  # maximum deviation from a whole number: 255 times the rounding error of half floats near 1
_MIN_LEVELS = 16  # minimum number of distinct values
_MIN_CURVATURE = 2e-3  # minimum curvature of 1 / distance that disproves a kind of depth
_PLANE = 0.1  # of it: maximum curvature in the right kind
# Depth edges, across which a wide pixel filter mixes colours.
_MIN_EDGES = 60  # minimum number of edges; of 31 edges of point samples, 65 % were mixed by chance
_MIN_CONTRAST = 0.15  # minimum difference of tone-mapped luminance across an edge
_FLAT = 0.06  # of the contrast: maximum change on either side of an edge
_MIXED = 0.12, 0.7  # of the contrast: range of a mixed pixel's difference from its side
_DEPTH_RATIO, _SAME_SURFACE = 1.1, 1.03  # minimum ratio of depths across an edge, maximum along a side
# Depth edges between rows, which are those of colour unless one of the two is upside down.
_MAX_ROW_EDGES = 4  # maximum weight of the edges of one row, each of which has 1 at most
_MIN_EDGE_WEIGHT = 80  # minimum weight of all edges
_NEAR_EDGES = (-8, -6, -4, -2, 2, 4, 6, 8)  # rows from an edge to the pixels that it is compared with
# Buffers with few, evenly spaced values: stored in 8 bits, or in half floats around an offset.
_MIN_VALUES, _MAX_VALUES = 6, 300  # distinct values of such a buffer
_PIXELS_EACH = 8  # minimum mean number of pixels with the same value
_UNEVEN = 0.1  # of a step: maximum deviation from even spacing
_MIN_UNEVEN = 0.02  # minimum fraction of pixels whose second difference is a step: rounding
_COARSE_MOTION = 0.2  # render pixels: minimum step of coarse motion
_MAX_OFF = 0.03  # of the unit: maximum difference of the median motion from a stored 0.5
_MAX_RESIDUAL = 0.5  # render pixels: maximum root mean square deviation from the motion of a plane


def single_frame_mistakes(frame: Frame, light: Float32 | None) -> Iterator[Mistake]:
    """Yield the mistakes in one frame; `light` is the luminance of its colour."""
    yield from _depth(frame.depth)
    if not frame.reset:  # across a cut motion leads to no history
        yield from _motion(frame)
    if frame.exposure is not None and usable_exposure(frame.exposure) is None:
        yield mistakes.EXPOSURE_OUT_OF_RANGE.found(exposure=frame.exposure)
    if frame.color is not None and light is not None:
        yield from _color(frame, frame.color, light)
        tone = tone_mapped(light, light)
        yield from upside_down(frame.depth, tone)
        mixed = mixed_edges(tone, frame.depth)
        if mixed > _MAX_MIXED:
            yield mistakes.COLOR_FILTERED.found(share=mixed)


# --- colour ---


def _color(frame: Frame, color: Array, light: Float32) -> Iterator[Mistake]:
    bad = ~np.isfinite(light)
    if bad.any():
        yield mistakes.COLOR_NOT_FINITE.found(where=where(bad))
    pixels = pixel_grid(frame.size)
    values = color[pixels].astype(np.float32)
    negative = float(np.mean(values < -1e-6))
    if negative > 0.01:
        yield mistakes.COLOR_NEGATIVE.found(share=negative)
    full = values == 1.0
    clipped = full.any(axis=1) & ~full.all(axis=1)  # clipped lights are rarely white
    stored = values, srgb_encoded(values)  # the latter by Conventions(srgb=True)
    if whole := [each.max() for each in stored if _are_whole(each)]:
        yield mistakes.COLOR_BYTES.found(high=whole[0])
    elif _are_whole(values * 255):
        yield mistakes.COLOR_EIGHT_BIT
    elif values.max() <= 1.0 and np.mean(clipped) > 0.005:
        yield mistakes.COLOR_CLIPPED
    elif top := _display_range(values, frame.depth[pixels], light):
        yield mistakes.COLOR_DISPLAYED.found(top=f"{top:g}", scale="" if top == 1 else "Divide by 255. ")


def _display_range(values: Float32, depth: Array, light: Float32) -> float:
    """Return 1 or 255 if colours fill that range and have the brightness of displayed images; otherwise 0.

    Highlights of linear scenes exceed such a bound, or most of the scene is much darker than half of it.
    """
    surface = values[depth > 0].max(axis=1)
    if len(surface) < _MIN_SURFACE or len(np.unique(depth)) < _MIN_DEPTHS:
        return 0.0
    dark, middle, bright = np.quantile(surface, (0.1, 0.5, 0.9)).tolist()
    high = float(values.max())
    if bright - dark < _MIN_SPREAD * high:  # an even image, for example with a few lamps
        return 0.0
    if not np.mean(np.abs(np.diff(light))) < _MAX_CHANGE * np.std(light):  # noise, or NaN
        return 0.0
    fits = (top for top in (1.0, 255.0) if _FULL * top <= high <= top)
    return next((top for top in fits if _MIDDLE[0] <= middle / top <= _MIDDLE[1]), 0.0)


def _are_whole(values: Float32) -> bool:
    """Return whether nearly all values are whole numbers up to 255, at least _MIN_LEVELS distinct ones."""
    whole = np.rint(values)
    near = np.abs(values - whole) < _WHOLE
    return bool(near.mean() > 0.99 and whole.max() <= 255 and len(np.unique(whole)) >= _MIN_LEVELS)


def mixed_edges(tone: Float32, depth: Array) -> float:
    """Return the fraction of depth edges with a pixel of mixed colour; 0.0 if there are too few edges.

    Depth is sampled at a point. A pixel on one side of a depth edge has the colour of that side, unless
    colour is filtered. Only edges with even colour in 2x3 pixels on both sides count, as textures, noise and
    soft shadows look mixed. `tone` is luminance from `tone_mapped`.
    """
    away = np.concatenate([_edge_profiles(tone, depth), _edge_profiles(tone.T, depth.T)], axis=1)
    own, between = np.abs(away) < _MIXED[0], (away >= _MIXED[0]) & (away < _MIXED[1])
    sharp, mixed = int(own.all(axis=0).sum()), int((own & between[::-1]).sum())
    return mixed / (sharp + mixed) if sharp + mixed >= _MIN_EDGES else 0.0


def _edge_profiles(tone: Float32, depth: Array) -> NDArray[np.floating[Any]]:
    """Return (2, n) differences of the two pixels at each edge along rows from their sides.

    They are fractions of the contrast: 0 is the colour of a pixel's own side, 1 that of the other side.
    """
    if tone.shape[0] < 3 or tone.shape[1] < 6:
        return np.empty((2, 0))
    near, far = np.minimum(depth[:, :-1], depth[:, 1:]), np.maximum(depth[:, :-1], depth[:, 1:])
    edge, same = far > _DEPTH_RATIO * near, far <= _SAME_SURFACE * near
    at_edge = same[:, :-4] & same[:, 1:-3] & edge[:, 2:-2] & same[:, 3:-1] & same[:, 4:]
    around = sliding_window_view(tone, (3, 6))[at_edge[1:-1]]  # (n, 3, 6)
    start, end = around[:, 1:2, :1], around[:, 1:2, 5:]
    profile = (around - start) / (end - start)
    flat = np.abs(profile[:, :, [0, 1, 4, 5]] - (0.0, 0.0, 1.0, 1.0)) < _FLAT
    even = flat.all(axis=(1, 2)) & (np.abs(end - start)[:, 0, 0] > _MIN_CONTRAST)
    return np.stack([profile[even, 1, 2], 1.0 - profile[even, 1, 3]])


def upside_down(depth: Float32, tone: Float32) -> Iterator[Mistake]:
    """Yield a mistake if edges of `tone` (of `tone_mapped`) and depth agree only with one of them flipped.

    A horizon or the top of a box is one coincidence, however wide: the edges of a row have the weight of
    _MAX_ROW_EDGES at most.
    """
    height, width = depth.shape
    pixels = rows, columns = pixel_grid((width, height - 1), 4 * GRID_PIXELS)
    here, below = depth[rows, columns], depth[rows + 1, columns]
    is_edge = np.abs(here - below) > 0.1 * np.maximum(here, below)  # Inf - Inf, reported by `_depth`
    edges = rows[is_edge], columns[is_edge]
    weights = np.minimum(1.0, _MAX_ROW_EDGES / np.bincount(edges[0], minlength=1)[edges[0]])
    if weights.sum() < _MIN_EDGE_WEIGHT:
        return
    upright, turned = (_edge_contrast(each, pixels, edges, weights) for each in (tone, tone[::-1]))
    if turned > 1.5 and turned > 1.5 * upright:
        yield mistakes.COLOR_UPSIDE_DOWN.found(times=turned / max(upright, 1e-6))


def _edge_contrast(
    tone: Float32, pixels: PixelGrid, edges: PixelGrid, weights: NDArray[np.floating[Any]]
) -> float:
    """Return the mean change of brightness from row to row at edges, relative to other pixels.

    These are all pixels, or those above and below the edges if they change more: a flip moves edges of one
    half of the image into the texture of the other half.
    """

    def change(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.floating[Any]]:
        rows = np.clip(rows, 0, tone.shape[0] - 2)
        changes: NDArray[np.floating[Any]] = np.nan_to_num(
            np.abs(tone[rows, columns] - tone[rows + 1, columns])
        )
        return changes

    rows, columns = edges
    near = np.mean([np.average(change(rows + step, columns), weights=weights) for step in _NEAR_EDGES])
    others = max(float(near), float(change(*pixels).mean()), 1e-6)
    return float(np.average(change(rows, columns), weights=weights)) / others


# --- depth ---


def _depth(depth: Float32) -> Iterator[Mistake]:
    bad = ~np.isfinite(depth)
    if bad.any():
        yield mistakes.DEPTH_NOT_FINITE.found(where=where(bad))
        return
    low, high = float(depth.min()), float(depth.max())
    if low < 0:
        yield mistakes.DEPTH_NEGATIVE.found(low=low)
    elif count := depth_values(depth):
        yield mistakes.DEPTH_COARSE.found(count=count)
    elif kind := _other_kind(depth, low, high):
        yield mistakes.depth_kind(f"it looks {kind}", kind)


def _other_kind(depth: Float32, low: float, high: float) -> str:
    """Return "forward" or "linear" if depth is likely of that kind; "" if it may be reversed.

    1 / depth is linear along planes for linear depth. Reversed depth of a parallel projection looks the same,
    but its values are in [0, 1].
    """
    if low == high:
        return ""
    if high >= 1e6:  # for example a sky of 1e10; near / distance has no such values
        return "linear"
    values = depth[pixel_grid((depth.shape[1], depth.shape[0]))]
    if high == 1 and sky_fraction(values, "forward") > 0.02 and sky_fraction(values, "reversed") == 0:
        return "forward"
    # As reversed depth, all surfaces would be within 1.11 times the near plane's distance, unevenly.
    if low >= 0.9 and high <= 1 and 1 - low >= 4 * (1 - high) and np.median(values) > 0.95:
        return "forward"
    if low == 0 or np.median(values) <= 1:
        return ""
    as_reversed, as_linear = plane_curvature(depth, "reversed"), plane_curvature(depth, "linear")
    return "linear" if as_reversed > _MIN_CURVATURE and as_linear < _PLANE * as_reversed else ""


def depth_values(depth: Array) -> int:
    """Return the number of evenly spaced values of coarse depth, or 1 / depth; 0 for finer depth."""
    rows, columns = pixel_grid((max(0, depth.shape[1] - 2), depth.shape[0]))
    line = np.stack([depth[rows, columns + x] for x in range(3)]).astype(np.float64)
    line = line[:, ((line > 0.0) & (line < 1e6)).all(axis=0)]  # no sky
    for values in (line, 1.0 / line):
        if step := _even_step(values[1]):
            bends = np.rint(np.abs(np.diff(values, 2, axis=0)) / step)  # planes with even values have none
            if np.mean(np.isin(bends, (1, 2))) > _MIN_UNEVEN:
                return len(np.unique(values[1]))
    return 0


def _even_step(values: NDArray[np.floating[Any]]) -> float:
    """Return the spacing of the distinct values; 0.0 if these are too many, or uneven."""
    distinct = np.unique(values.astype(np.float64))
    if not _MIN_VALUES <= len(distinct) <= min(_MAX_VALUES, len(values) // _PIXELS_EACH):
        return 0.0
    spacing = np.diff(distinct)
    count = np.rint(spacing.sum() / spacing.min())
    step = spacing.sum() / count
    steps = np.cumsum(spacing) / step
    even = np.abs(steps - np.rint(steps)).max() < _UNEVEN and count <= 4 * _MAX_VALUES
    return float(step) if even else 0.0


# --- motion ---


def _motion(frame: Frame) -> Iterator[Mistake]:
    bad = ~np.isfinite(np.add(frame.motion[..., 0], frame.motion[..., 1], dtype=np.float32))
    if bad.any():
        yield mistakes.MOTION_NOT_FINITE.found(where=where(bad))
        return
    pixels = pixel_grid(frame.size)
    vectors = frame.motion[pixels].astype(np.float32)
    off = (np.abs(vectors) > np.array(frame.size, np.float32)).any(axis=1)
    if np.mean(off) > 0.05 and min(frame.size) >= 16:
        yield mistakes.MOTION_TOO_LONG.found(share=np.mean(off))
    middle = np.median(vectors, axis=0)
    halves = np.abs(middle) / frame.size  # 0.5 is half of the image in UV, a quarter in NDC
    if min(frame.size) >= 16 and any(np.abs(halves - half).max() < _MAX_OFF for half in (0.25, 0.5)):
        yield mistakes.MOTION_OFFSET.found(x=middle[0], y=middle[1])
        return
    if np.abs(np.abs(middle) - 0.5).max() < _MAX_OFF and np.abs(vectors).max() <= 1.0:
        yield mistakes.MOTION_OFFSET_PIXELS.found(x=middle[0], y=middle[1])
    step = max(_even_step(vectors[:, axis]) for axis in (0, 1))
    if step >= _COARSE_MOTION:
        yield mistakes.MOTION_COARSE.found(step=step)
    is_constant = frame.depth.min() == frame.depth.max()
    if is_constant and not off.all() and _is_not_planar(vectors[~off], *(each[~off] for each in pixels)):
        yield mistakes.DEPTH_CONSTANT


def _is_not_planar(vectors: Float32, rows: NDArray[Any], columns: NDArray[Any]) -> bool:
    """Return whether motion deviates from a homography, which is the motion of a plane and of the sky."""
    pixels = np.stack([columns, rows], axis=1)
    scale = pixels.max() + 1.0
    here, before = (np.insert(each / scale, 2, 1.0, axis=1) for each in (pixels, pixels + vectors))
    zeros = np.zeros_like(here)
    equations = [
        np.hstack([*sides, -before[:, [axis]] * here[:, :2]])
        for axis, sides in enumerate(((here, zeros), (zeros, here)))
    ]
    *found, x, y = np.linalg.lstsq(np.vstack(equations), before[:, :2].T.ravel(), rcond=None)[0]
    fit = here @ np.array([found[:3], found[3:], [x, y, 1.0]]).T
    residual = scale * (fit[:, :2] / fit[:, 2:] - before[:, :2])
    return bool(np.mean(residual**2) > _MAX_RESIDUAL**2)
