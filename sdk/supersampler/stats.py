"""What an Upscaler has done."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Stats:
    """What an Upscaler has done since it was made.

    Attributes:
        frames: frames stepped.
        extrapolated: those of them that were not shaded.
        resets: times that the history was dropped, the first frame's included.
        seconds: wall time spent in steps, without drawing the colour of frames that were not shaded.
        extrapolation_seconds: wall time spent on that.
        work: of the work that drawing every pixel of every frame is, how many frames' worth was done; a
            `frames - work` was skipped.
        full_frames: frames of which every pixel was drawn.
        full_seconds: wall time spent on those.
    """

    frames: int = 0
    extrapolated: int = 0
    resets: int = 0
    seconds: float = 0.0
    extrapolation_seconds: float = 0.0
    work: float = 0.0
    full_frames: int = 0
    full_seconds: float = 0.0

    def after_step(self, *, fresh: bool, work: float, seconds: float) -> "Stats":
        """Return these with one more step.

        Args:
            fresh: whether it had no past.
            work: share of a whole step's that was done.
            seconds: that it took.
        """
        full = work == 1.0
        return replace(
            self,
            frames=self.frames + 1,
            resets=self.resets + fresh,
            seconds=self.seconds + seconds,
            work=self.work + work,
            full_frames=self.full_frames + full,
            full_seconds=self.full_seconds + (seconds if full else 0.0),
        )

    def after_drawing(self, seconds: float) -> "Stats":
        """Return these with the colour of one more frame drawn, whose step they have."""
        drawn, taken = self.extrapolated + 1, self.extrapolation_seconds + seconds
        return replace(self, extrapolated=drawn, extrapolation_seconds=taken)

    @property
    def saved_seconds(self) -> float:
        """What all frames would have taken at the pace of the full ones, less what they took."""
        if not self.full_frames:
            return 0.0
        return self.full_seconds / self.full_frames * self.frames - self.seconds
