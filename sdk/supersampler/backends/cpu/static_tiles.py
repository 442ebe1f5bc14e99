"""Which tiles of a frame equal those of the last frame with the same jitter."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import RENDER_TILE
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.array_spec import ArraySpec

Bool = NDArray[np.bool_]
Int32 = NDArray[np.int32]
Sums = NDArray[np.uint64]
Jitter = tuple[float, float]
ReadFingerprints = Callable[[Bool, int], Sums]
"""Fingerprints of tiles, (rows, columns), from every n-th row of samples; MOVING where a tile has motion, any
number outside of the mask."""

MOVING = 0
"""Fingerprint of a tile with motion; in a `Phase`: no fingerprint yet."""
PHASES = 256
"""Longest jitter sequence; with a longer one, or one that never repeats, no tile counts as static."""
ROW_STEP = 4
"""Every tile is first compared by one row of samples in so many, and as a whole only if these agree."""
SAMPLED_ROWS = 16
"""After a frame in which every tile moved, one row of tiles in so many shows whether all move again."""
LOOK_FRAMES = 8
"""Where most tiles change in each frame, only one frame in so many of a period is looked at."""
HOLD_FRAMES = 2
"""Frames for which a tile that stood still for a whole period may change, and be taken as undisturbed if it
then is as before: fireflies, NaN."""
LEAST_SHARE = 1.0 / 3.0
"""Share of tiles that need not be computed, below which leaving them out saves no time."""
_PATIENCE = 2 * PHASES
"""Frames with changes after which a tile is compared as a whole only where its rows agree."""
_MAX_FRAMES = 1 << 53


class Phase(NamedTuple):
    """The last frame with some jitter.

    Attributes:
        frame: its number.
        rows: (tile rows, tile columns) fingerprints of the compared rows of tiles. Tiles that moved or are
            `StaticTiles.held` have that of the frame before with this jitter.
        tiles: likewise of whole tiles.
    """

    frame: int
    rows: Sums
    tiles: Sums


def mostly(mask: Bool) -> bool:
    """Whether all but less than LEAST_SHARE of the tiles are in a mask."""
    return bool(np.count_nonzero(mask) > (1.0 - LEAST_SHARE) * mask.size)


@dataclass(frozen=True, eq=False)
class StaticTiles:
    """Fingerprints of the frames so far; immutable, so histories share it.

    Arrays are (rows, columns) of tiles of the frame.

    Attributes:
        render: (width, height) of the frames.
        frames: number of frames so far.
        phases: last frame with each jitter; oldest first.
        period: frames since the last frame with this frame's jitter; 0 where there was none.
        moving: tiles with motion in this frame.
        same: tiles without motion that equal those of the last frame with this jitter.
        held: tiles that differ, but are taken as undisturbed if they are as before within HOLD_FRAMES.
        changed: all other tiles that differ.
        changes: consecutive frames in which a tile differed.
        matched: consecutive frames in which it was the same.
        confirmed: tiles that were the same for as many frames as there are phases, and since then have only
            moved, been held or been the same.
        unsteady: consecutive frames in which most tiles changed, or moved where others changed.
    """

    render: Size
    frames: int
    phases: Mapping[Jitter, Phase]
    period: int
    moving: Bool
    same: Bool
    held: Bool
    changed: Bool
    changes: Int32
    matched: Int32
    confirmed: Bool
    unsteady: int = 0

    @classmethod
    def empty(cls, render: Size) -> "StaticTiles":
        """Return the state before the first frame."""
        shape = tuple(-(-extent // RENDER_TILE) for extent in render[::-1])
        none, zero = np.zeros(shape, bool), np.zeros(shape, np.int32)
        return cls(render, 0, {}, 0, none, none, none, none, zero, zero, none)

    def after(self, jitter: Jitter, read: ReadFingerprints) -> "StaticTiles":
        """Return the state after one more frame of the same size.

        Args:
            jitter: of the frame.
            read: its fingerprints.
        """
        unknown = np.zeros(self.same.shape, np.uint64)
        before = self.phases.get(jitter, Phase(self.frames, unknown, unknown))
        period = self.frames - before.frame
        if self._likely_changes(period) or (self.moving.all() and self._likely_moves(read)):
            phases = self._phases_with(jitter, before._replace(frame=self.frames))
            unsteady = 0 if mostly(self.moving) else self.unsteady + 1
            return replace(self, frames=self.frames + 1, phases=phases, period=period, unsteady=unsteady)
        as_before = self.same & (before.tiles != MOVING)  # likely: read at once as a whole
        if as_before.any():
            as_before &= read(as_before, 1) == before.tiles
        rows = (
            before.rows if as_before.all() else np.where(as_before, before.rows, read(~as_before, ROW_STEP))
        )
        agree = (rows == before.rows) & (rows != MOVING)
        unseen = (before.rows == MOVING) & (period > 0 or len(self.phases) < PHASES)
        patient = self.changes < (2 * period or _PATIENCE)
        whole = (rows != MOVING) & (agree | unseen | (patient & (before.rows != MOVING)))
        unread = whole & ~as_before
        tiles = np.where(as_before, before.tiles, np.uint64(MOVING))
        if unread.any():
            tiles = np.where(unread, read(unread, 1), tiles)
        moving = (rows == MOVING) | (whole & (tiles == MOVING))
        same = ~moving & (tiles == before.tiles) & (tiles != MOVING)
        differs = ~moving & (before.rows != MOVING) & ~same & ((before.tiles != MOVING) | ~agree)
        changes = np.where(differs, self.changes + 1, np.where(agree | moving, 0, self.changes))
        held = differs & self.confirmed & (changes <= HOLD_FRAMES)
        matched = np.where(same, self.matched + 1, 0)
        confirmed = (same & (matched >= len(self.phases))) | (self.confirmed & (~differs | held))
        keep = moving | held
        stored = np.where(keep, before.rows, rows), np.where(keep, before.tiles, tiles)
        phases, changed = self._phases_with(jitter, Phase(self.frames, *stored)), differs & ~held
        unsteady = self.unsteady + 1 if mostly(moving | changed) and not mostly(moving) else 0
        return StaticTiles(
            self.render, self.frames + 1, phases, period, moving, same, held, changed,
            changes.astype(np.int32), matched.astype(np.int32), confirmed, unsteady,
        )  # fmt: skip

    def _likely_changes(self, period: int) -> bool:
        """Whether most tiles changed for more than a period, and this frame is none of those looked at.

        These have the same jitter in each period, so that they can be compared.
        """
        return period > 0 and self.frames % period % LOOK_FRAMES != 0 and self.unsteady > period

    def _likely_moves(self, read: ReadFingerprints) -> bool:
        """Whether all tiles of some rows move, others in each frame."""
        step = min(SAMPLED_ROWS, len(self.moving))
        sampled = np.zeros(self.moving.shape, bool)
        sampled[self.frames % step :: step] = True
        return bool((read(sampled, ROW_STEP)[sampled] == MOVING).all())

    def _phases_with(self, jitter: Jitter, last: Phase) -> dict[Jitter, Phase]:
        phases = {key: phase for key, phase in self.phases.items() if key != jitter}
        while len(phases) >= PHASES:
            del phases[next(iter(phases))]
        return {**phases, jitter: last}

    def latest_jitters(self, frames: int) -> list[Jitter]:
        """Return the different jitters of the last `frames` frames."""
        return [jitter for jitter, phase in self.phases.items() if phase.frame >= self.frames - frames]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return copies for `of_arrays`; none before the first frame."""
        if not self.frames:
            return {}
        phases = self.phases.values()
        return {
            "static.frames": np.array(self.frames, np.int64),
            "static.unsteady": np.array(self.unsteady, np.int64),
            "static.jitter": np.array(list(self.phases), np.float64),
            "static.phase_frames": np.array([phase.frame for phase in phases], np.int64),
            "static.phase_rows": np.stack([phase.rows for phase in phases]),
            "static.phase_tiles": np.stack([phase.tiles for phase in phases]),
            "static.changes": self.changes.copy(),
            "static.matched": self.matched.copy(),
            "static.confirmed": self.confirmed.copy(),
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]], render: Size) -> "StaticTiles":
        """Continue from arrays by `arrays`, other arrays among them; begin anew where there are none.

        Args:
            arrays: as `static_tile_specs` says.
            render: size of the last frame.

        Raises:
            ArgumentError: a jitter was seen after the last frame.
        """
        empty = cls.empty(render)
        if "static.frames" not in arrays:
            return empty
        frames, numbers = int(arrays["static.frames"]), arrays["static.phase_frames"]
        if numbers.max() >= frames:
            raise ArgumentError(
                "state",
                got=f"with 'static.phase_frames' up to {numbers.max()}",
                want=f"less than 'static.frames', {frames}",
            )
        jitters = [(float(x), float(y)) for x, y in arrays["static.jitter"]]
        sums = zip(numbers, arrays["static.phase_rows"], arrays["static.phase_tiles"], strict=True)
        phases = [Phase(int(number), rows.copy(), tiles.copy()) for number, rows, tiles in sums]
        changes, matched, confirmed = (
            arrays[f"static.{name}"].copy() for name in ("changes", "matched", "confirmed")
        )
        none = empty.same
        return cls(
            render, frames, dict(zip(jitters, phases, strict=True)), 0, none, none, none, none, changes,
            matched, confirmed, int(arrays["static.unsteady"]),
        )  # fmt: skip


def static_tile_specs(render: Size) -> dict[str, ArraySpec]:
    """Return the shapes and values of `StaticTiles.arrays` after a frame of this size."""
    tiles = tuple(-(-extent // RENDER_TILE) for extent in render[::-1])
    count = 0, 1 << 30
    return {
        "static.frames": ArraySpec("int64", (), (1, _MAX_FRAMES)),
        "static.unsteady": ArraySpec("int64", (), (0, _MAX_FRAMES)),
        "static.jitter": ArraySpec("float64", ("phases", 2), (-0.5, 0.5)),
        "static.phase_frames": ArraySpec("int64", ("phases",), (0, _MAX_FRAMES)),
        "static.phase_rows": ArraySpec("uint64", ("phases", *tiles)),
        "static.phase_tiles": ArraySpec("uint64", ("phases", *tiles)),
        "static.changes": ArraySpec("int32", tiles, count),
        "static.matched": ArraySpec("int32", tiles, count),
        "static.confirmed": ArraySpec("bool", tiles),
    }
