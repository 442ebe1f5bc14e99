"""Class maps: each class has its colour, and the image stays visible."""

import numpy as np

from supersampler.aux_outputs import CLASS_COLORS, NO_CLASS
from supersampler.io.shot import ClassMaps
from supersampler_model.data.dataset.overview import overlay

NAMES = [
    ["nothing", "geometry", "texture"],
    ["visibility", "visibility, aliased", "visibility, aliased"],
    ["shading", "shading", "shading"],  # the last two never come of `label`
]


def labels() -> ClassMaps:
    """Return all combinations: ghosting classes by row, aliasing classes by column."""
    return ClassMaps(*np.indices((3, 3)).astype(np.uint8))


def test_each_class_has_a_color_of_its_own() -> None:
    tinted = overlay(labels(), np.full((3, 3, 3), 255, np.uint8))
    for row, names in enumerate(NAMES):
        for column, name in enumerate(names):
            expected = 255 if name == "nothing" else 0.4 * 255 + 0.6 * np.array(CLASS_COLORS[name])
            np.testing.assert_allclose(tinted[row, column], expected, atol=1)
    assert len({*CLASS_COLORS.values(), NO_CLASS}) == len(CLASS_COLORS) + 1


def test_classes_differ_for_colour_blind_eyes() -> None:
    """Seen without reds (Viénot 1999, protanopia) any two differ by more than a tenth of white."""
    linear = np.array([*CLASS_COLORS.values(), NO_CLASS]) / 255.0
    linear = np.where(linear <= 0.04045, linear / 12.92, ((linear + 0.055) / 1.055) ** 2.4)
    blind = linear @ np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]).T
    seen = np.clip(blind, 0.0, 1.0) ** (1 / 2.2)
    apart = np.linalg.norm(seen[:, None] - seen[None], axis=-1) + np.eye(len(seen))
    assert apart.min() > 0.1


def test_pixels_without_a_class_are_grey() -> None:
    red = np.zeros((3, 3, 3), np.uint8)
    red[..., 0] = 200
    assert np.ptp(overlay(labels(), red)[0, 0].astype(int)) == 0
