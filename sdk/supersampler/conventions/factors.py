"""Factors that convert motion vectors and jitter to render pixels, x right and y down."""

from supersampler.conventions.fields import ConventionFields
from supersampler.frame import Size


def motion_factor(conventions: ConventionFields, size: Size, own_size: Size) -> tuple[float, float]:
    """Return the factor (x, y) from a stored vector to render pixels, previous minus current.

    Args:
        conventions: conventions of the vector.
        size: render size.
        own_size: size of the motion buffer: render or display size.
    """
    sign = 1.0 if conventions.motion_direction == "previous_minus_current" else -1.0
    return _signed_factor(conventions, size, own_size, sign)


def motion_next_factor(conventions: ConventionFields, size: Size, own_size: Size) -> tuple[float, float]:
    """Return what `motion_factor` does, for `motion_next`: to render pixels, next minus current."""
    sign = 1.0 if conventions.motion_next_direction == "next_minus_current" else -1.0
    return _signed_factor(conventions, size, own_size, sign)


def _signed_factor(
    conventions: ConventionFields, size: Size, own_size: Size, sign: float
) -> tuple[float, float]:
    x, y = _pixels_per_unit(conventions.motion_unit, size, own_size)
    scale_x, scale_y = conventions.motion_scale
    return sign * scale_x * x, sign * scale_y * (-y if conventions.motion_flip_y else y)


def jitter_factor(conventions: ConventionFields, size: Size) -> tuple[float, float]:
    """Return the factor (x, y) from a stored jitter to render pixels, pixel centre to sample."""
    x, y = _pixels_per_unit(conventions.jitter_unit, size, size)
    sign = conventions.jitter_sign
    return sign * x, sign * (-y if conventions.jitter_flip_y else y)


def _pixels_per_unit(unit: str, size: Size, own_size: Size) -> tuple[float, float]:
    if unit == "pixels":
        return size[0] / own_size[0], size[1] / own_size[1]
    return (float(size[0]), float(size[1])) if unit == "uv" else (size[0] / 2.0, -size[1] / 2.0)
