"""The fields of `Conventions` and their checks."""

from dataclasses import dataclass, fields
from typing import Literal, get_args, get_origin

from supersampler.arguments import as_number, checked_choice
from supersampler.conventions.encodings import DepthKind
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Size

Unit = Literal["pixels", "uv", "ndc"]
Direction = Literal["previous_minus_current", "current_minus_previous"]
NextDirection = Literal["next_minus_current", "current_minus_next"]
Resolution = Literal["render", "display"]

_MIN_FACTOR, _MAX_FACTOR = 1e-30, 1e30  # factors for single precision
_RANGE = f"{_MIN_FACTOR:g} to {_MAX_FACTOR:g}"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConventionFields:
    """The fields of `Conventions`, which documents them."""

    motion_unit: Unit = "pixels"
    motion_scale: tuple[float, float] = (1.0, 1.0)
    motion_direction: Direction = "previous_minus_current"
    motion_next_direction: NextDirection = "next_minus_current"
    motion_flip_y: bool = False
    motion_resolution: Resolution = "render"
    motion_jittered: bool = False
    depth: DepthKind = "reversed_infinite"
    near: float = 0.1
    far: float | None = None
    jitter_unit: Unit = "pixels"
    jitter_sign: int = 1
    jitter_flip_y: bool = False
    bottom_up: bool = False
    srgb: bool = False

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if get_origin(field.type) is Literal:
                checked_choice(field.name, value, get_args(field.type))
            elif field.type is bool and not isinstance(value, bool):
                raise ArgumentError(field.name, got=shown(value), want="True or False")
        if _number(self.jitter_sign) not in (1.0, -1.0):
            raise ArgumentError("jitter_sign", got=shown(self.jitter_sign), want="+1 or -1")
        object.__setattr__(self, "motion_scale", _checked_scale(self.motion_scale))
        self._check_planes()

    def _check_planes(self) -> None:
        if not _is_usable(self.near) or self.near <= 0:
            hint = "near is the distance of the near plane, also where depth is reversed."
            want = f"a finite distance > 0, {_RANGE}"
            raise ArgumentError("near", got=shown(self.near), want=want, hint=hint)
        if self.far is None:
            if self.depth in ("reversed", "forward"):
                hint = f"Without a far plane it is depth='{self.depth}_infinite'."
                want = f"a distance, as depth is '{self.depth}'"
                raise ArgumentError("far", got=None, want=want, hint=hint)
            return
        if not _is_usable(self.far) or self.far <= self.near:
            hint = "far is the farther plane, also where depth is reversed."
            want = f"finite and > near = {self.near}, or None"
            raise ArgumentError("far", got=shown(self.far), want=want, hint=hint)
        if self.depth.endswith("infinite"):
            raise ArgumentError("far", got=self.far, want=f"None, as depth is '{self.depth}'")


def _number(value: object) -> float | None:
    """Return a number that JSON can hold as a float; None for other values."""
    return as_number(value) if isinstance(value, int | float) else None


def _is_usable(value: object) -> bool:
    number = _number(value)
    return number is not None and _MIN_FACTOR <= abs(number) <= _MAX_FACTOR


def _checked_scale(scale: object) -> tuple[float, float]:
    if isinstance(scale, tuple | list) and len(scale) == 2 and all(map(_is_usable, scale)):
        return float(scale[0]), float(scale[1])
    want = f"(x, y), two finite numbers that are not 0, {_RANGE}"
    raise ArgumentError("motion_scale", got=shown(scale), want=want)


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
    """Return the factor (x, y) from a stored `motion_next` to render pixels, next minus current."""
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
