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

    def after_step(
        self, *, fresh: bool, work: float, seconds: float, extrapolation_seconds: float | None = None
    ) -> "Stats":
        """Return these with one more step.

        Args:
            fresh: whether it had no past.
            work: share of a whole step's that was done.
            seconds: that it took.
            extrapolation_seconds: that the frame's colour took before; None where it was shaded.
        """
        full, extrapolated = work == 1.0, extrapolation_seconds is not None
        return replace(
            self,
            frames=self.frames + 1,
            extrapolated=self.extrapolated + extrapolated,
            extrapolation_seconds=self.extrapolation_seconds + (extrapolation_seconds or 0.0),
            resets=self.resets + fresh,
            seconds=self.seconds + seconds,
            work=self.work + work,
            full_frames=self.full_frames + full,
            full_seconds=self.full_seconds + (seconds if full else 0.0),
        )

    @property
    def saved_seconds(self) -> float:
        """What all frames would have taken at the pace of the full ones, less what they took."""
        if not self.full_frames:
            return 0.0
        return self.full_seconds / self.full_frames * self.frames - self.seconds
