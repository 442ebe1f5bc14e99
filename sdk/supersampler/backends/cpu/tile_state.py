"""What tells, from frame to frame, which tiles of a picture may stay as they are."""

import itertools
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import TILE
from supersampler.backends.cpu.static_tiles import StaticTiles, static_tile_specs
from supersampler.backends.cpu.tiles import Bool, runs_of, scaled
from supersampler.frame import Float32, Size
from supersampler.methods.array_spec import ArraySpec, values_of

_STAMPS = itertools.count(1)


def next_generation() -> int:
    """A number that no tile has had."""
    return next(_STAMPS)


class TileState:
    """What goes from frame to frame beside a picture.

    Args:
        display: size of the picture.

    Attributes:
        stamps: of each tile; where two histories have the same, they hold the same. 0: nothing.
        stillness: of the frames.
        matched: of each tile, frames in a row in which all that it looks at was as one period before.
        still: tiles whose picture is as it was one period before, too.
        looks: what the picture was; shared with the histories before.
        looked: of each tile, the stamp that it has there.
        pending: tiles of this history's own image that the next step copies into `looks`, so that a step
            which is interrupted changes nothing of the histories before; None where there are none.
        work: of each tile, the share that the step did.
    """

    def __init__(self, display: Size) -> None:
        shape = -(-display[1] // TILE), -(-display[0] // TILE)
        self.generations = np.zeros(shape, np.int64)
        self.stillness = StaticTiles()
        self.matched = np.zeros(shape, np.int32)
        self.still = np.zeros(shape, bool)
        self.looks: Looks | None = None
        self.looked = np.zeros(shape, np.int64)
        self.pending: Pending | None = None
        self.work = np.ones(shape, np.float32)

    def follow(self, past: "TileState", stillness: StaticTiles, same: Bool) -> None:
        """Know what the past knew, and that these tiles look at what they looked at one period before."""
        self.stillness = stillness
        self.matched = np.where(same, past.matched + 1, 0).astype(np.int32)
        self.still = past.still & same
        self.looks, self.looked = past.looks, past.looked.copy()

    def forget(self) -> None:
        """Know nothing."""
        self.stillness, self.looks, self.pending = StaticTiles(), None, None
        self.matched[:], self.still[:] = 0, False

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Copies, for `load`."""
        arrays = self.stillness.arrays()
        if arrays:
            arrays |= {"still.matched": self.matched.copy(), "still.tiles": self.still.copy()}
        if self.looks is not None:
            arrays["still.looks"] = pixels = self.looks.pixels.copy()
            arrays["still.looked"] = looked = self.looked == self.looks.generations
            if self.pending is not None:
                looked |= self.pending.tiles
                for y0, y1, x0, x1 in scaled(runs_of(self.pending.tiles), TILE, pixels.shape[1::-1]):
                    pixels[y0:y1, x0:x1] = self.pending.image[y0:y1, x0:x1, :3]
        return arrays

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from there, arrays as `tile_state_specs` says; the picture is loaded, too.

        Raises:
            ArgumentError: they contradict each other.
        """
        self.generations[:] = next_generation()
        self.stillness = StaticTiles.of_arrays(arrays)
        if "still.matched" in arrays:
            self.matched, self.still = arrays["still.matched"].copy(), arrays["still.tiles"].copy()
        if "still.looks" in arrays:
            self.looked = np.where(arrays["still.looked"], next_generation(), 0)
            self.looks = Looks(arrays["still.looks"].copy(), self.looked.copy())


def tile_state_specs(names: Collection[str], display: Size, render: Size) -> dict[str, ArraySpec]:
    """What arrays by `TileState.arrays` must be, where any of their names is among these.

    Args:
        names: of arrays, others among them.
        display: size of the picture.
        render: size of the frame that left them.
    """
    looks, still = {"still.looks", "still.looked"}, {name for name in names if name.startswith("still.")}
    if not still:
        return {}
    tiles = tuple(-(-extent // TILE) for extent in display[::-1])
    specs = static_tile_specs(render)
    specs["still.matched"] = ArraySpec("int32", tiles, (0, np.iinfo(np.int32).max))
    specs["still.tiles"] = ArraySpec("bool", tiles)
    if looks & still:
        specs["still.looks"] = ArraySpec("float32", (*display[::-1], 3), values_of("still.looks"))
        specs["still.looked"] = ArraySpec("bool", tiles)
    return specs


class Pending(NamedTuple):
    """Tiles of a history's image.

    Attributes:
        tiles: which.
        image: (H, W, 3 or more) linear RGB in the first channels.
    """

    tiles: Bool
    image: NDArray[Any]


@dataclass(eq=False)
class Looks:
    """What tiles of the picture were when they were last looked at.

    Attributes:
        pixels: (H, W, 3) linear RGB.
        stamps: of each tile, which look it is.
    """

    pixels: Float32
    generations: NDArray[np.int64]
