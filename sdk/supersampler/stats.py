"""What an Upscaler has done."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Stats:
    """What an Upscaler has done since it was made.

    Attributes:
        frames: frames stepped.
        resets: times that the history was dropped, the first frame's included.
        seconds: wall time spent in `step`.
        work: of the work that drawing every pixel of every frame is, how many frames' worth was done; a
            `frames - work` was skipped.
        full_frames: frames of which every pixel was drawn.
        full_seconds: wall time spent on those.
    """

    frames: int = 0
    resets: int = 0
    seconds: float = 0.0
    work: float = 0.0
    full_frames: int = 0
    full_seconds: float = 0.0

    @property
    def saved_seconds(self) -> float:
        """What all frames would have taken at the pace of the full ones, less what they took."""
        if not self.full_frames:
            return 0.0
        return self.full_seconds / self.full_frames * self.frames - self.seconds
