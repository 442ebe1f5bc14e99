"""Chooses by measured times whether frames that move are upscaled, and how large they are rendered."""

_SCALES = (1.0, 1.25, 1.5, 1.75, 2.0)  # window size / render size
_BUDGET = 0.4  # of the time of a plain frame, for one that moves
_MAX_SHARE = 0.9  # of that time; above it upscaling does not pay
_NEW = 0.3  # weight of the last time in the mean


class Pace:
    """Times of plain frames and of frames that moved.

    Args:
        scale: window size / render size of frames that move; None chooses the largest render size whose
            frames take at most 0.4 of the time of a plain one, at least half the window's.
        ratios: least and largest scale of the model.
        force: whether to upscale where that takes more than 0.9 of the time of a plain frame.

    Attributes:
        plain: seconds of a plain frame; None until the second one, as the first compiles shaders.
    """

    def __init__(self, scale: float | None, ratios: tuple[float, float], *, force: bool) -> None:
        self.plain: float | None = None
        allowed = [one for one in _SCALES if ratios[0] <= one <= ratios[1]]
        self._scales = tuple(allowed) if scale is None else (scale,)
        self._force = force
        self._moved: dict[float, float] = {}
        self._warm: set[object] = set()

    @property
    def is_timed(self) -> bool:
        """Whether frames may move: whether plain ones were timed, where that matters."""
        return self.plain is not None or (self._force and len(self._scales) == 1)

    @property
    def pays(self) -> bool:
        """Whether upscaling takes less time than plain frames."""
        least = self._moved.get(self._scales[-1])
        return self._force or self.plain is None or least is None or least < _MAX_SHARE * self.plain

    @property
    def moved(self) -> float:
        """Seconds of a frame that moved, at the smallest render size."""
        return self._moved[self._scales[-1]]

    @property
    def scale(self) -> float:
        """Window size / render size of the next frame that moves."""
        chosen = self._scales[-1]
        for scale in reversed(self._scales):  # the first that was not timed is tried if the ones before fit
            chosen = scale if self._fits(scale) else chosen
            if scale not in self._moved or not self._fits(scale):
                break
        return chosen

    def add(self, scale: float | None, seconds: float) -> None:
        """Add a frame that moved, or a plain one if `scale` is None."""
        if scale not in self._warm:  # the first compiles or allocates
            self._warm.add(scale)
        elif scale is None:
            self.plain = seconds if self.plain is None else self.plain + _NEW * (seconds - self.plain)
        else:
            before = self._moved.get(scale, seconds)
            self._moved[scale] = before + _NEW * (seconds - before)

    def restart(self) -> None:
        """Forget all times, as of another window size."""
        self.plain = None
        self._moved.clear()

    def _fits(self, scale: float) -> bool:
        seconds = self._moved.get(scale, 0.0)
        return self.plain is None or seconds <= _BUDGET * self.plain
