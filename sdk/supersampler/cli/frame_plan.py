"""Which frames of a shot a run steps through, and which of them it writes."""

from collections.abc import Callable
from dataclasses import dataclass

from supersampler.conventions import jitter_phase_count
from supersampler.errors import ShotError
from supersampler.io.shot import Shot
from supersampler.io.shot.numbered import FrameNumbers

LEAST_PREROLL = 32
LONGEST_PREROLL = jitter_phase_count(4.0)
"""Smallest and largest default preroll."""


EXPOSURE_FRAMES = 96
"""Frames before a preroll of which the exposure is measured. A measured exposure moves a tenth of the way in
a frame: of the exposure before these frames 0.9^96 is left, 4e-5."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Indices of frames to step through: `start`, which begins without a history, to `stop` - 1.

    Two passes also read those up to `end` - 1, which is `stop` or later: the backward run begins there.
    """

    start: int
    stop: int
    end: int


@dataclass(frozen=True, slots=True)
class FramePlan:
    """The frames of a run.

    Attributes:
        numbers: of the frames that are written.
        segments: in order, those that lead to the frames.
        first_number: number of the frame with index 0.
    """

    numbers: FrameNumbers
    segments: tuple[Segment, ...]
    first_number: int

    def position(self, index: int) -> int | None:
        """Return the position of a frame among the written ones, by its index; None where it is none."""
        number = self.first_number + index
        return self.numbers.position(number) if number in self.numbers else None

    def rest(self, shot: Shot, position: int) -> list[Segment]:
        """Return what is stepped through to write the frames from a position on."""
        if position >= len(self.numbers):
            return []
        index = self.numbers[position] - self.first_number
        return [
            Segment(
                max(segment.start, shot.last_cut(min(max(index, segment.start), segment.stop - 1))),
                segment.stop,
                segment.end,
            )
            for segment in self.segments
            if segment.stop > index
        ]


def default_preroll(scale: float) -> int:
    """Return the frames before a range that build its history: one period of the jitter, at least 32.

    docs/how-to/farm.md shows how near its images then are to those of a run of the whole shot.

    Args:
        scale: display size / render size.
    """
    return min(max(LEAST_PREROLL, jitter_phase_count(scale)), LONGEST_PREROLL)


def open_for(
    numbers: FrameNumbers,
    preroll: int | None,
    open_frames: Callable[[tuple[int, int]], Shot],
    passes: int = 1,
) -> tuple[Shot, str]:
    """Open what a run reads of a shot: gaps elsewhere are no matter.

    Args:
        numbers: of the frames to write.
        preroll: frames before each range; None is the default of the ratio.
        open_frames: opens the frames from a first to a last number; ShotError where one between is missing.
        passes: 2 also reads frames after a range, for the backward run, where there is no gap.

    Returns:
        The shot, and a note: where a frame before the preroll is missing, exposure is measured after it.
        Then there are no frames after the ranges, either.
    """
    before = (LONGEST_PREROLL if preroll is None else preroll) + EXPOSURE_FRAMES
    least = LEAST_PREROLL if preroll is None else preroll
    after = least if passes == 2 else 0
    try:
        return open_frames((numbers.first - before, numbers.last + after)), ""
    except ShotError as error:
        shot = open_frames((numbers.first - least, numbers.last))
        return shot, f"History and exposure begin at frame {shot.first_number}: {error.problem}."


def plan_frames(shot: Shot, numbers: FrameNumbers | None, preroll: int, passes: int = 1) -> FramePlan:
    """Return the plan of a run.

    Args:
        shot: the shot.
        numbers: of the frames to write; None is all of them, in one segment.
        preroll: number of frames before a range that build its history, as far as there are and no cut is
            among them. The backward run of two passes has as many after a range.
        passes: 1 or 2.

    Raises:
        ShotError: the shot has no frame of one of the numbers.
    """
    begin, end = shot.first_number, shot.first_number + len(shot) - 1
    if numbers is None:
        return FramePlan(FrameNumbers(((begin, end),)), (Segment(0, len(shot), len(shot)),), begin)
    missing = next(
        (number for a, b in numbers.ranges for number in (a, b) if not begin <= number <= end), None
    )
    if missing is not None:
        raise ShotError(shot.path, f"has no frame {missing}", f"Its frames are {begin} to {end}.")
    segments: list[Segment] = []
    for first, last in numbers.ranges:
        index, stop = first - begin, last - begin + 1
        cut = shot.last_cut(index)
        start = max(cut, index - preroll)
        while start > cut and not shot.is_shaded(start):  # history begins with colour
            start -= 1
        if segments and start <= segments[-1].stop:
            start = segments.pop().start
        end = stop
        while passes == 2 and end < min(stop + preroll, len(shot)) and shot.last_cut(end) != end:
            end += 1
        segments.append(Segment(start, stop, end))
    return FramePlan(numbers, tuple(segments), begin)
