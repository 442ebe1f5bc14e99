"""False-colour images of auxiliary outputs: class map, weight of the history, sample count, frozen pixels."""

from collections.abc import Mapping

import numpy as np

from supersampler.frame import Float32
from supersampler.history import StepResult
from supersampler.io.compare import Legend, false_color, false_color_legend
from supersampler.io.images import Bytes

NO_CLASS = (24, 24, 24)
"""sRGB of a pixel without ghosting and aliasing."""
CLASS_COLORS: Mapping[str, tuple[int, int, int]] = {
    "visibility": (213, 94, 0),  # vermilion
    "visibility, aliased": (204, 121, 167),  # purple
    "shading": (240, 228, 66),  # yellow
    "geometry": (86, 180, 233),  # sky blue
    "texture": (0, 158, 115),  # green
}
"""sRGB of each class, from the colour-blind-safe palette of Okabe and Ito."""

MAX_SAMPLES = 64.0
"""Sample count at the end of the colour scale."""

LEGENDS: Mapping[str, Legend] = {
    "classes": Legend(colors=[f"rgb{color}" for color in CLASS_COLORS.values()], names=tuple(CLASS_COLORS)),
    "weight": false_color_legend("this frame", "history"),
    "count": false_color_legend("no sample", f"{MAX_SAMPLES:.0f}, by logarithm"),
    "converged": false_color_legend("the method's image", "frozen mean of the samples"),
}
"""Legend of each layer; see `compare.About`."""


def aux_output_layers(result: StepResult) -> dict[str, Bytes]:
    """Return an image of each auxiliary output of `result`, by its name in LEGENDS.

    Each is (h, w, 3) uint8 sRGB, in the size of the output.
    """
    layers = {}
    if result.class_map is not None:
        layers["classes"] = class_colors(result.class_map)
    if result.weight is not None:
        layers["weight"] = false_color(result.weight)
    if result.count is not None:
        layers["count"] = false_color(np.log1p(result.count) / np.log1p(MAX_SAMPLES))
    if result.converged is not None:
        layers["converged"] = false_color(result.converged)
    return layers


def class_colors(probabilities: Float32) -> Bytes:
    """Mix the colours of the classes by their probabilities; aliased ghosting has its own colour.

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
