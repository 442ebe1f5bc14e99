"""`detect_conventions`: detects the conventions of a few frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from supersampler.arguments import as_index
from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.fields import Resolution
from supersampler.errors import ArgumentError, shown
from supersampler.validation.detection import Detection
from supersampler.validation.evidence import Evidence
from supersampler.validation.rankings import (
    jitters_in_the_pixel,
    rank_depth,
    rank_jitter,
    rank_motion,
    swapped_axes,
)
from supersampler.validation.reprojection import frame_pairs

if TYPE_CHECKING:  # which loads OpenImageIO
    from supersampler.io.shot import Shot


def detect_conventions(
    shot: "Shot | Sequence[RawFrame]", *, frames: int = 6, conventions: Conventions | None = None
) -> Detection:
    """Detect the conventions of some consecutive frames.

    Tries every motion unit, direction and flip, with jitter in the vectors and without, and every jitter
    unit, sign and flip, and ranks them by how well they reproject the previous image. The kind of depth
    follows from disocclusions, the sky and planes. Where the evidence is uncertain, the stated conventions
    are kept.

    Args:
        shot: a `Shot`, whose middle is read, or raw frames in order.
        frames: number of frames to read, >= 2. Motion with jitter in it needs 3; more are more certain.
        conventions: the stated conventions; by default the shot's, or `Conventions()`. Rows, sRGB, planes and
            motion scale are taken from it unchecked.

    Raises:
        ArgumentError: there are fewer than two frames, or an argument has a wrong type.
        FrameError: depth or motion has a wrong shape, or is no array.
    """
    stated = _stated(shot, conventions)
    seen = [Evidence.of_raw(raw, stated) for raw in _middle(shot, frames)]
    resolution: Resolution = "render" if seen[0].motion.shape[:2] == seen[0].depth.shape else "display"
    found = replace(stated, motion_resolution=resolution)
    textured = [pair for pair in frame_pairs(seen) if pair.textured]
    jitters = jitters_in_the_pixel(seen, stated)
    motion = rank_motion(textured, jitters, found)
    found = replace(found, **motion.overrides)
    jitter = rank_jitter(textured, jitters, found)
    found = replace(found, **jitter.overrides)
    depth = rank_depth(textured, seen, found)
    notes = [str(mistake.error()) for mistake in swapped_axes(textured, jitters, found)]
    found = replace(found, **depth.overrides)
    if found.depth != stated.depth and found.depth.endswith("infinite"):
        kind = found.depth.removesuffix("_infinite")
        notes.append(f"A far plane cannot be seen; where there is one, depth='{kind}' with near and far.")
    return Detection(motion, jitter, depth, stated, found, tuple(notes))


def _stated(shot: "Shot | Sequence[RawFrame]", conventions: Conventions | None) -> Conventions:
    listed = isinstance(shot, Sequence) and all(isinstance(raw, RawFrame) for raw in shot)
    if not listed and not hasattr(shot, "read_raw"):
        raise ArgumentError("shot", got=shown(shot), want="a Shot, or RawFrames in a list")
    if conventions is None:
        return Conventions() if isinstance(shot, Sequence) else shot.conventions
    if not isinstance(conventions, Conventions):
        raise ArgumentError("conventions", got=shown(conventions), want="Conventions, or None")
    return conventions


def _middle(shot: "Shot | Sequence[RawFrame]", frames: int) -> list[RawFrame]:
    requested = as_index(frames)
    count = None if requested is None else min(requested, len(shot))
    if count is None or count < 2:
        got = shown(frames) if count is None else count
        raise ArgumentError("frames", got=got, want="at least 2 frames to compare")
    start = max(0, (len(shot) - count) // 2)
    indices = range(start, start + count)
    return [shot[i] if isinstance(shot, Sequence) else shot.read_raw(i) for i in indices]
