"""`RawFrame`: one frame in an engine's conventions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from supersampler.frame import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RawFrame:
    """One frame in an engine's conventions, unchecked; `Converter.to_frame` checks and converts it.

    Attributes:
        depth: (h, w) at render size, of the kind `Conventions.depth`.
        motion: (h, w, 2), x then y; (H, W, 2) where `Conventions.motion_resolution` is "display".
        color: (h, w, 3) at render size, linear or sRGB; None on an unshaded frame.
        jitter: (x, y) in the unit `Conventions.jitter_unit`; None is no jitter.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies the colour before the tone curve, or None.
        pre_exposure: what the renderer has multiplied the colour by.
        reactive: (h, w) at render size, in [0, 1], or None.
        gbuffer: G-buffers at render size, with the names of `Frame`.
        gbuffer_display: G-buffers at display size, with the names of `Frame`; its depth is of `depth`'s kind.
        aovs: (h, w, k) at render size.
        motion_next: (h, w, 2) or (H, W, 2), as `motion`: to the next frame, in the unit and signs of `motion`
            and the direction `Conventions.motion_next_direction`.
        aov_names: names of the k AOVs' channels in files of results; None numbers them.
    """

    depth: Array
    motion: Array
    color: Array | None = None
    jitter: tuple[float, float] | None = None
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    reactive: Array | None = None
    gbuffer: Mapping[str, Array] | None = None
    gbuffer_display: Mapping[str, Array] | None = None
    aovs: Array | None = None
    aov_names: Sequence[str] | None = None
    motion_next: Array | None = None
