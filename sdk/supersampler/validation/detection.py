"""`detect_conventions`: detects units, signs and depth from a few frames."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from supersampler.arguments import as_index, ieee_arithmetic
from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.conventions import Resolution, checked_conventions
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.validation import mistakes, rankings
from supersampler.validation.checker import frame_mistakes
from supersampler.validation.mistakes import Mistake
from supersampler.validation.probe import FrameProbe, tone_mapped
from supersampler.validation.rankings import Detection
from supersampler.validation.reprojection import frame_pairs
from supersampler.validation.single_frame import upside_down
from supersampler.validation.temporal import FramesSeen

if TYPE_CHECKING:  # importing it loads OpenImageIO
    from supersampler.io.shot import Shot

_VERDICT_KINDS = {
    mistakes.DEPTH_NOT_REVERSED.kind, mistakes.JITTER_CONSTANT.kind, mistakes.JITTER_MISREAD.kind,
    mistakes.JITTER_TOO_SMALL.kind, mistakes.MOTION_MISREAD.kind,
}  # fmt: skip
"""Kinds of mistakes that the verdicts report."""


@ieee_arithmetic
def detect_conventions(
    shot: "Shot | Sequence[RawFrame]", *, frames: int = 6, conventions: Conventions | None = None
) -> Detection:
    """Detect the conventions of some consecutive frames.

    Tries every motion unit, direction and flip, with and without jitter in the vectors, and every jitter
    unit, sign and flip, and ranks them by how well they reproject the previous image. The kind of depth
    follows from disocclusions, the sky and planes. The stated conventions are kept where the evidence is
    uncertain.

    Args:
        shot: a `Shot`, whose middle is read, or raw frames in order.
        frames: number of frames to read, >= 2. Jitter in motion vectors needs 3; more are more certain.
        conventions: the stated conventions; by default the shot's, or `Conventions()`. Rows, sRGB, near and
            far plane, and motion scale are not detected.

    Raises:
        ArgumentError: there are fewer than two frames, or an argument has a wrong type.
        FrameError: an input has a wrong shape, or is not of its kind.
    """
    stated = _stated(shot, conventions)
    raws = _middle(shot, frames)
    seen = [FrameProbe.of_raw(raw, stated) for raw in raws]
    always_reset = all(frame.reset for frame in seen)
    if always_reset:
        raws = [replace(raw, reset=index == 0) for index, raw in enumerate(raws)]
        seen = [replace(frame, reset=index == 0) for index, frame in enumerate(seen)]
    resolution: Resolution = "render" if seen[0].motion.shape[:2] == seen[0].depth.shape else "display"
    found = replace(stated, motion_resolution=resolution)
    textured = [pair for pair in frame_pairs(seen) if pair.textured and not _turned(pair.now)]
    jitters = rankings.jitters_in_the_pixel(seen, stated)
    motion = rankings.rank_motion(textured, jitters, found)
    found = replace(found, **motion.overrides)
    jitter = rankings.rank_jitter(textured, jitters, found)
    found = replace(found, **jitter.overrides)
    depth = rankings.rank_depth(textured, seen, found)
    found = replace(found, **depth.overrides)
    swapped, notes = rankings.swapped_axes(textured, jitters, found), list[str]()
    if found.depth != stated.depth and found.depth.endswith("infinite"):
        kind = found.depth.removesuffix("_infinite")
        notes.append(f"Images do not show a far plane. If there is one, write depth='{kind}', near and far.")
    flips = "motion_flip_y", "jitter_flip_y"
    likely = replace(found, **jitter.ranked[0].overrides) if jitter.ranked else found
    if all(getattr(likely, name) != getattr(stated, name) for name in flips):
        own = {name: getattr(stated, name) for name in flips}
        others = ", ".join(f"{name}={not value}" for name, value in own.items())
        notes.append(f"Rows seem to be bottom-up. Only if the image is upright, write {others} instead.")
        found = replace(found, **own, bottom_up=not stated.bottom_up)
    elif found.jitter_flip_y != stated.jitter_flip_y and not motion.certain:
        turned = f"bottom_up={not stated.bottom_up}"
        notes.append(f"If the image is upside down, write {turned} instead of jitter_flip_y.")
    further, refused = _other_mistakes(raws, found)
    if mistakes.MOTION_OFFSET.kind in (mistake.kind for mistake in further):
        swapped = []  # with such vectors, nothing fits
    notes = [*(str(mistake.error()) for mistake in swapped), *notes]
    notes += [*(str(mistake.error()) for mistake in further), *refused]
    has_mistakes = bool(refused or swapped) or any(mistake.severity == "error" for mistake in further)
    if always_reset := always_reset and any(pair.continues for pair in textured):
        notes.append(str(mistakes.RESET_ALWAYS.found(frames=len(raws)).error()))
    has_mistakes |= always_reset
    return Detection(motion, jitter, depth, stated, found, tuple(notes), has_mistakes)


def _turned(frame: FrameProbe) -> bool:
    """Return whether colour is upside down relative to depth: then no reading of the motion fits."""
    return frame.light is not None and any(upside_down(frame.depth, tone_mapped(frame.light, frame.light)))


def _other_mistakes(raws: Sequence[RawFrame], found: Conventions) -> tuple[list[Mistake], list[str]]:
    """Return the mistakes in frames with these conventions, except those that the verdicts report.

    The second list has the error of a frame that cannot be converted.
    """
    converter, seen = found.converter(), FramesSeen()
    by_kind: dict[str, Mistake] = {}
    refused: list[str] = []
    for raw in raws:
        try:  # motion to the next frame with jitter in it cannot be converted
            frame = converter.to_frame(replace(raw, motion_next=None) if found.motion_jittered else raw)
        except (FrameError, ArgumentError) as error:
            refused.append(str(error))
            break
        evidence = FrameProbe.of_frame(frame)
        seen = FramesSeen() if frame.reset else seen
        seen = seen.after(evidence, frame.size)
        by_kind |= {each.kind: each for each in frame_mistakes(frame, evidence, seen, frame.size)}
    ignored = _VERDICT_KINDS | (mistakes.OF_SRGB if found.srgb else set())
    return [mistake for kind, mistake in by_kind.items() if kind not in ignored], refused


def _stated(shot: "Shot | Sequence[RawFrame]", conventions: Conventions | None) -> Conventions:
    listed = isinstance(shot, Sequence) and all(isinstance(raw, RawFrame) for raw in shot)
    if not listed and not hasattr(shot, "read_raw"):
        raise ArgumentError("shot", got=shown(shot), want="a Shot, or RawFrames in a list")
    if conventions is None:
        return Conventions() if isinstance(shot, Sequence) else shot.conventions
    return checked_conventions(conventions)


def _middle(shot: "Shot | Sequence[RawFrame]", frames: int) -> list[RawFrame]:
    requested, want = as_index(frames), "at least 2 frames to compare"
    if requested is None or requested < 2:
        raise ArgumentError("frames", got=shown(frames), want=want)
    if len(shot) < 2:
        raise ArgumentError("shot", got=f"of length {len(shot)}", want=want)
    count = min(requested, len(shot))
    start = max(0, (len(shot) - count) // 2)
    indices = range(start, start + count)
    return [shot[i] if isinstance(shot, Sequence) else shot.read_raw(i) for i in indices]
