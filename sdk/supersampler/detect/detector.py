"""`detect`: from a few frames to the conventions they are in."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, Protocol

from supersampler.conventions import Conventions, RawFrame
from supersampler.detect.detection import Detection
from supersampler.detect.evidence import Still, steps
from supersampler.detect.rankings import (
    jitters_in_the_pixel,
    rank_depth,
    rank_jitter,
    rank_motion,
    swapped_axes,
)
from supersampler.errors import ArgumentError
from supersampler.reprojection import MIN_PLACES


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
        ArgumentError: there are fewer than two frames.
        FrameError: depth or motion is of a wrong shape, or not an array.
    """
    stated = conventions or (Conventions() if isinstance(shot, Sequence) else shot.conventions)
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


def _middle(shot: RawFrames | Sequence[RawFrame], frames: int) -> list[RawFrame]:
    if min(frames, len(shot)) < 2:
        raise ArgumentError("frames", got=min(frames, len(shot)), want="at least 2 frames to compare")
    start = max(0, (len(shot) - frames) // 2)
    indices = range(start, min(len(shot), start + frames))
    return [shot[i] if isinstance(shot, Sequence) else shot.read_raw(i) for i in indices]


def _motion_resolution(still: Still) -> Literal["render", "display"]:
    return "render" if still.motion.shape[:2] == still.depth.shape else "display"
