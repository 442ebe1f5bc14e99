"""Which tiles of a frame equal those of the frame one jitter period before."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import RENDER_TILE
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.array_spec import ArraySpec

Sums = NDArray[np.uint64]
Jitter = tuple[float, float]

MOVING = 0
"""Fingerprint of a tile with motion; such a tile is never static."""
PHASES = 256
"""Longest jitter sequence; with a longer one, or one that never repeats, no tile counts as static."""
_MAX_FRAMES = 1 << 53


@dataclass(frozen=True, eq=False)
class StaticTiles:
    """Fingerprints of the frames so far; immutable, so histories share it.

    Attributes:
        frames: number of frames so far.
        phases: by jitter: number of the last frame with it, fingerprints of its tiles; oldest first.
        period: frames since the last frame with this frame's jitter; 0 where there was none.
        same: (rows, columns) tiles that equal those of that frame and do not move; None before the first
            frame.
    """

    frames: int = 0
    phases: Mapping[Jitter, tuple[int, Sums]] = field(default_factory=dict)
    period: int = 0
    same: NDArray[np.bool_] | None = None

    def after(self, jitter: Jitter, sums: Sums) -> "StaticTiles":
        """Return the state after one more frame.

        Args:
            jitter: of the frame.
            sums: (rows, columns) fingerprints of its tiles.
        """
        base = self if self.same is not None and self.same.shape == sums.shape else StaticTiles()
        last_frame, sums_before = base.phases.get(jitter, (base.frames, None))
        same = (
            (sums == sums_before) & (sums != MOVING)
            if sums_before is not None
            else np.zeros(sums.shape, bool)
        )
        phases = {key: phase for key, phase in base.phases.items() if key != jitter}
        while len(phases) >= PHASES:
            del phases[next(iter(phases))]
        phases[jitter] = base.frames, sums
        return StaticTiles(base.frames + 1, phases, base.frames - last_frame, same)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return copies for `of_arrays`; none before the first frame."""
        if self.same is None:
            return {}
        return {
            "still.frames": np.array(self.frames, np.int64),
            "still.jitter": np.array(list(self.phases), np.float64),
            "still.when": np.array([when for when, _ in self.phases.values()], np.int64),
            "still.sums": np.stack([sums for _, sums in self.phases.values()]),
            "still.same": self.same.copy(),
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "StaticTiles":
        """Continue from arrays by `arrays`, other arrays among them; begin anew where there are none.

        Args:
            arrays: as `static_tile_specs` says.

        Raises:
            ArgumentError: a jitter was seen after the last frame.
        """
        if "still.frames" not in arrays:
            return cls()
        jitter, when, sums = (arrays[f"still.{name}"] for name in ("jitter", "when", "sums"))
        frames = int(arrays["still.frames"])
        if when.max() >= frames:
            raise ArgumentError(
                "state",
                got=f"with 'still.when' up to {when.max()}",
                want=f"less than 'still.frames', {frames}",
            )
        keys = [(float(x), float(y)) for x, y in jitter]
        phases = {key: (int(frame), seen.copy()) for key, frame, seen in zip(keys, when, sums, strict=True)}
        return cls(frames, phases, same=arrays["still.same"].copy())


def static_tile_specs(render: Size) -> dict[str, ArraySpec]:
    """Return the shapes and values of `StaticTiles.arrays` after a frame of this size."""
    tiles = tuple(-(-extent // RENDER_TILE) for extent in render[::-1])
    return {
        "still.frames": ArraySpec("int64", (), (1, _MAX_FRAMES)),
        "still.jitter": ArraySpec("float64", ("phases", 2), (-0.5, 0.5)),
        "still.when": ArraySpec("int64", ("phases",), (0, _MAX_FRAMES)),
        "still.sums": ArraySpec("uint64", ("phases", *tiles)),
        "still.same": ArraySpec("bool", tiles),
    }
