"""`FrameNumbers`: ranges of frame numbers, as renderers and farms write them: 10-50,60."""

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate, pairwise
from zlib import crc32

from supersampler.errors import ArgumentError
from supersampler.io.shot.format import is_frame_range

_LONGEST_LABEL = 80  # characters; more would make file names too long


@dataclass(frozen=True, slots=True)
class FrameNumbers:
    """Frame numbers in ascending order.

    Attributes:
        ranges: (first, last) of each range, both included; each begins after the end of the one before.
    """

    ranges: tuple[tuple[int, int], ...]

    @classmethod
    def parse(cls, text: str, name: str) -> "FrameNumbers":
        """Return the numbers of "10-50,60" or "-12--3"; ArgumentError, with `name`, for anything else."""
        parts = [
            re.fullmatch(r"\s*(-?\d{1,10})\s*(?:-\s*(-?\d{1,10})\s*)?", part) for part in text.split(",")
        ]
        found = tuple((int(part[1]), int(part[2] or part[1])) for part in parts if part)
        ordered = all(first <= last for first, last in found)
        rising = all(before[1] < after[0] for before, after in pairwise(found))
        if None in parts or not (ordered and rising) or not is_frame_range(found[0][0], found[-1][1]):
            want = "frame numbers in ascending order, such as 10-50,60"
            hint = "Every frame between is needed: motion leads to the frame before." * bool(
                re.search(r"\d[x:]\d", text)
            )
            raise ArgumentError(name, got=repr(text), want=want, hint=hint)
        return cls(found)

    @property
    def first(self) -> int:
        """The least number."""
        return self.ranges[0][0]

    @property
    def last(self) -> int:
        """The largest number."""
        return self.ranges[-1][1]

    @property
    def label(self) -> str:
        """The numbers as a part of file names: 0010-0050_0060."""
        label = "_".join(f"{a:04d}" if a == b else f"{a:04d}-{b:04d}" for a, b in self.ranges)
        short = f"{self.first:04d}-{self.last:04d}_{crc32(label.encode()):08x}"
        return label if len(label) <= _LONGEST_LABEL else short

    def __str__(self) -> str:
        return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in self.ranges)

    def __len__(self) -> int:
        return sum(last + 1 - first for first, last in self.ranges)

    def __iter__(self) -> Iterator[int]:
        for first, last in self.ranges:
            yield from range(first, last + 1)

    def __contains__(self, number: object) -> bool:
        return isinstance(number, int) and any(first <= number <= last for first, last in self.ranges)

    def __getitem__(self, position: int) -> int:
        """Return the number at a position, from 0."""
        starts = list(accumulate((last + 1 - first for first, last in self.ranges), initial=0))
        if not 0 <= position < starts[-1]:
            raise IndexError(f"frame {position} of {starts[-1]}")
        at = bisect_right(starts, position) - 1
        return self.ranges[at][0] + position - starts[at]

    def overlaps(self, other: "FrameNumbers") -> bool:
        """Return whether a number is in both."""
        return any(a <= d and c <= b for a, b in self.ranges for c, d in other.ranges)

    def position(self, number: int) -> int:
        """Return the position of a number, from 0; ValueError where it is not among these."""
        before = 0
        for first, last in self.ranges:
            if first <= number <= last:
                return before + number - first
            before += last + 1 - first
        raise ValueError(f"{number} is not in {self}")
