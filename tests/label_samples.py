"""Samples and inputs of the label rules, of analytic scenes: the reference for what the renderer gathers."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from supersampler.frame import Size
from supersampler_model.data.labels import LabelInputs, PixelStatistics, Values, toned
from supersampler_model.data.scenes.analytic import EXTENT, AnalyticScene, grids, places


class Sample(NamedTuple):
    """One sample of every pixel, at some position in the pixel."""

    color: Values  # (H, W, 3) linear scene RGB, >= 0
    depth: Values  # (H, W) reversed, 0 at the sky
    normal: Values  # (H, W, 3) of the surface without its normal map; unit length, 0 at the sky
    normal_mapped: Values  # (H, W, 3) with its normal map


def statistics_of(samples: Iterable[Sample], exposure: float = 1.0) -> PixelStatistics:
    """Gather the samples of one frame; the first has the normals that the others are compared with.

    `exposure` multiplies the colours before they are toned.
    """
    color, depth, normal, mapped = (np.array(values) for values in zip(*samples, strict=True))
    lit = toned(color, exposure)
    spread, mapped_spread = (np.abs(v - v[0]).sum(axis=-1).max(axis=0) for v in (normal, mapped))
    arrays = {
        "depth_min": depth.min(axis=0), "depth_max": depth.max(axis=0), "color_min": lit.min(axis=0),
        "color_max": lit.max(axis=0), "color": color.mean(axis=0), "normal_spread": spread,
        "normal_mapped_spread": mapped_spread,
    }  # fmt: skip
    return PixelStatistics(**{name: array.astype(np.float32) for name, array in arrays.items()})


def samples(scene: AnalyticScene, index: int, size: Size, count: int = 8) -> Iterator[Sample]:
    """Yield count x count regular ones of each pixel, the upper left one first."""
    for x, y in grids(size, count):
        surface = scene.surface(index, x, y)
        yield Sample(surface.color, surface.depth, surface.normal, surface.normal_mapped)


def label_inputs(scene: AnalyticScene, index: int, size: Size) -> LabelInputs:
    """Return the inputs of the label rules, at exposure 1, from an 8x8 grid per pixel."""
    centers = scene.surface(index, *places(size))
    return LabelInputs(
        pixels=statistics_of(samples(scene, index, size, 8)),
        motion=(centers.motion * np.array(size) / EXTENT).astype(np.float32),
        depth_before=centers.depth_before.astype(np.float32),
        cut=scene.cut(index),
    )
