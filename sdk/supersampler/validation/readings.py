"""All readings of motion and jitter that the checks and the detector try: overrides of `Conventions`."""

from itertools import product
from typing import Any, Literal, get_args

from supersampler.conventions import Conventions
from supersampler.conventions.fields import Direction, Unit

Overrides = dict[str, Any]

MOTIONS: tuple[Overrides, ...] = tuple(
    {"motion_unit": unit, "motion_direction": direction, "motion_flip_y": flip}
    for unit, direction, flip in product(get_args(Unit), get_args(Direction), (False, True))
)
JITTERS: tuple[Overrides, ...] = tuple(
    {"jitter_unit": unit, "jitter_sign": sign, "jitter_flip_y": flip}
    for unit, sign, flip in product(get_args(Unit), (1, -1), (False, True))
)


def reading_text(field: Literal["motion", "jitter"], reading: Conventions) -> str:
    """Return a reading of motion or jitter as text: "uv, current minus previous, y flipped"."""
    if field == "jitter":
        sign = "centre + jitter" if reading.jitter_sign == 1 else "centre - jitter"
        return f"{reading.jitter_unit}, {sign}{', y flipped' if reading.jitter_flip_y else ''}"
    unit = reading.motion_unit if reading.motion_scale == (1.0, 1.0) else "display pixels"
    flip = ", y flipped" if reading.motion_flip_y else ""
    jitter = ", with jitter in it" if reading.motion_jittered else ""
    return f"{unit}, {reading.motion_direction.replace('_', ' ')}{flip}{jitter}"
