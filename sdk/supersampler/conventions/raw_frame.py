"""One frame as an engine gives it, before `Conventions` made sense of it."""

from collections.abc import Mapping
from dataclasses import dataclass

from supersampler.frame import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawFrame:
    """One frame in somebody's own conventions. Nothing is checked here: `Converter.to_frame` does that.

    Attributes:
        depth: (h, w) at render size, of the kind that `Conventions.depth` says.
        motion: (h, w, 2), x then y; at display size (H, W, 2) where `Conventions.motion_resolution` says so.
        color: (h, w, 3) at render size, linear or sRGB; None on a frame that was not shaded.
        jitter: (x, y) in the unit that `Conventions.jitter_unit` says. None is no jitter.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies the colour before the tone curve, or None.
        gbuffer: at render size, names as in `Frame`.
        gbuffer_display: at display size, names as in `Frame`; its depth is of the same kind as `depth`.
        aovs: (h, w, k) at render size.
    """

    depth: Array
    motion: Array
    color: Array | None = None
    jitter: tuple[float, float] | None = None
    reset: bool = False
    exposure: float | None = None
    gbuffer: Mapping[str, Array] | None = None
    gbuffer_display: Mapping[str, Array] | None = None
    aovs: Array | None = None
