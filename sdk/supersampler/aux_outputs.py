"""Images of a method's auxiliary outputs: class map, weight of the history, sample count, work."""

from collections.abc import Mapping

import numpy as np

from supersampler.backends.cpu.layout import TILE
from supersampler.frame import Float32
from supersampler.history import StepResult
from supersampler.io.compare import Legend, false_color, false_color_legend
from supersampler.io.images import Bytes

NO_CLASS = (24, 24, 24)
"""sRGB of a pixel without a class."""
CLASS_COLORS: Mapping[str, tuple[int, int, int]] = {
    "visibility": (213, 94, 0),  # vermilion
    "visibility, aliased": (204, 121, 167),  # purple
    "shading": (240, 228, 66),  # yellow
    "geometry": (86, 180, 233),  # sky blue
    "texture": (0, 158, 115),  # green
}
"""sRGB of each class, of Okabe and Ito: colour-blind people tell them apart."""

MOST_SAMPLES = 64.0
"""The count that its false colours end at."""

LEGENDS: Mapping[str, Legend] = {
    "classes": Legend(colors=[f"rgb{color}" for color in CLASS_COLORS.values()], names=tuple(CLASS_COLORS)),
    "weight": false_color_legend("this frame", "history"),
    "count": false_color_legend("no sample", f"{MOST_SAMPLES:.0f}, by logarithm"),
    "work": false_color_legend("reused", "computed"),
}
"""By layer, for `compare.About`."""


def aux_output_layers(result: StepResult) -> dict[str, Bytes]:
    """Return the layers classes, weight, count and work of a `ComparePage`, those that `result` has.

    Each is (h, w, 3) uint8 sRGB, of the size of its map; work is of the image's.
    """
    layers = {}
    if result.class_map is not None:
        layers["classes"] = class_colors(result.class_map)
    if result.weight is not None:
        layers["weight"] = false_color(result.weight)
    if result.count is not None:
        layers["count"] = false_color(np.log1p(result.count) / np.log1p(MOST_SAMPLES))
    if result.work is not None:
        layers["work"] = false_color(_spread(result.work, *result.image.shape[:2]))
    return layers


def _spread(tiles: Float32, height: int, width: int) -> Float32:
    """(rows, columns) of tiles, the last of which are cut off, as pixels."""
    return np.kron(tiles, np.ones((TILE, TILE), np.float32))[:height, :width]


def class_colors(probabilities: Float32) -> Bytes:
    """Mix the classes' colours by their probabilities; aliased ghosting has a colour of its own.

    Args:
        probabilities: (h, w, 6), see `StepResult.class_map`.

    Returns:
        (h, w, 3) uint8 sRGB.
    """
    _, disoccluded, changed, plain, geometry, texture = (probabilities[..., i, None] for i in range(6))
    colors = {name: np.array(color, np.float32) for name, color in CLASS_COLORS.items()}
    aliasing = plain * np.array(NO_CLASS) + geometry * colors["geometry"] + texture * colors["texture"]
    ghosting = plain * colors["visibility"] + (1.0 - plain) * colors["visibility, aliased"]
    mixed = (1.0 - disoccluded - changed) * aliasing + disoccluded * ghosting + changed * colors["shading"]
    return np.asarray(np.clip(np.rint(mixed), 0, 255), np.uint8)
