"""`detect`: from a few frames to the conventions they are in."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, Protocol

from supersampler.arguments import as_index
from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ArgumentError, shown
from supersampler.validation.detection import Detection
from supersampler.validation.evidence import Still, steps
from supersampler.validation.rankings import (
    jitters_in_the_pixel,
    rank_depth,
    rank_jitter,
    rank_motion,
    swapped_axes,
)
from supersampler.validation.reprojection import MIN_PLACES


class RawFrames(Protocol):
    """What the detector needs of a `Shot`."""

    @property
    def conventions(self) -> Conventions:
        """What is stated about the frames."""

    def __len__(self) -> int: ...

    def read_raw(self, index: int) -> RawFrame:
        """Return one frame as stored."""


def detect_conventions(
    shot: RawFrames | Sequence[RawFrame], *, frames: int = 6, conventions: Conventions | None = None
) -> Detection:
    """Find out which conventions some consecutive frames are in.

    Every motion unit, direction and flip, with jitter in it and without, and every jitter unit, sign and flip
    is tried, and ranked by how well it carries each picture to the next. Depth is told by what hides what, by
    the sky and by planes. Where the frames cannot tell, what was stated stands.

    Args:
        shot: a `Shot`, of which the middle is looked at, or raw frames in order.
        frames: how many to look at, >= 2. Motion with jitter in it takes 3; more make it surer.
        conventions: what is stated about them; by default what the shot says, or `Conventions()`. Rows, sRGB,
            planes and motion scale are taken from it unseen.

    Raises:
        ArgumentError: there are fewer than two frames, or an argument is of another kind.
        FrameError: depth or motion is of a wrong shape, or not an array.
    """
    stated = _stated(shot, conventions)
    stills = [Still(raw, stated) for raw in _middle(shot, frames)]
    found = replace(stated, motion_resolution=_motion_resolution(stills[0]))
    textured = [step for step in steps(stills) if step.pair.textured >= MIN_PLACES]
    jitters = jitters_in_the_pixel(stills, stated)
    motion = rank_motion(textured, jitters, found)
    found = replace(found, **motion.overrides)
    jitter = rank_jitter(textured, jitters, found)
    found = replace(found, **jitter.overrides)
    depth = rank_depth(textured, stills, found)
    notes = swapped_axes(textured, jitters, found)
    found = replace(found, **depth.overrides)
    if found.depth != stated.depth and found.depth.endswith("infinite"):
        kind = found.depth.removesuffix("_infinite")
        notes.append(f"A far plane cannot be seen; where there is one, depth='{kind}' with near and far.")
    return Detection(motion, jitter, depth, stated, found, tuple(notes))


def _stated(shot: RawFrames | Sequence[RawFrame], conventions: Conventions | None) -> Conventions:
    listed = isinstance(shot, Sequence) and all(isinstance(raw, RawFrame) for raw in shot)
    if not listed and not hasattr(shot, "read_raw"):
        raise ArgumentError("shot", got=shown(shot), want="a Shot, or RawFrames in a list")
    if conventions is None:
        return Conventions() if isinstance(shot, Sequence) else shot.conventions
    if not isinstance(conventions, Conventions):
        raise ArgumentError("conventions", got=shown(conventions), want="Conventions, or None")
    return conventions


def _middle(shot: RawFrames | Sequence[RawFrame], frames: int) -> list[RawFrame]:
    asked = as_index(frames)
    count = None if asked is None else min(asked, len(shot))
    if count is None or count < 2:
        got = shown(frames) if count is None else count
        raise ArgumentError("frames", got=got, want="at least 2 frames to compare")
    start = max(0, (len(shot) - count) // 2)
    indices = range(start, start + count)
    return [shot[i] if isinstance(shot, Sequence) else shot.read_raw(i) for i in indices]


def _motion_resolution(still: Still) -> Literal["render", "display"]:
    return "render" if still.motion.shape[:2] == still.depth.shape else "display"
