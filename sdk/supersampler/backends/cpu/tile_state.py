"""What the reuse of static tiles keeps from frame to frame."""

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

_GENERATIONS = itertools.count(1)


def next_generation() -> int:
    """Next unused tile generation."""
    return next(_GENERATIONS)


class TileState:
    """Which tiles of one history's image may be reused. All arrays are (rows, columns) of tiles.

    Args:
        display: size of the image.

    Attributes:
        generations: equal generations in two histories mean equal pixels; 0 is no content.
        static_tiles: fingerprints of the frames so far.
        matched: consecutive frames in which the samples of a tile equal those one jitter period before.
        still: tiles whose pixels equal those of one jitter period before, too.
        reference: earlier pixels that tiles are compared with; shared with the previous histories.
        reference_generations: of each tile, the generation that it expects in `reference`.
        pending: tiles of this history's image that the next step copies into `reference`; None where there
            are none. The copy waits, so that an interrupted step leaves earlier histories unchanged.
        work: share of a full step's work that was done for each tile, in [0, 1].
    """

    def __init__(self, display: Size) -> None:
        shape = -(-display[1] // TILE), -(-display[0] // TILE)
        self.generations = np.zeros(shape, np.int64)
        self.static_tiles = StaticTiles()
        self.matched = np.zeros(shape, np.int32)
        self.still = np.zeros(shape, bool)
        self.reference: ReferenceTiles | None = None
        self.reference_generations = np.zeros(shape, np.int64)
        self.pending: Pending | None = None
        self.work = np.ones(shape, np.float32)

    def follow(self, previous: "TileState", static_tiles: StaticTiles, same: Bool) -> None:
        """Continue from the previous state.

        Args:
            previous: the previous state.
            static_tiles: after this frame.
            same: tiles that read the same samples as one jitter period before.
        """
        self.static_tiles = static_tiles
        self.matched = np.where(same, previous.matched + 1, 0).astype(np.int32)
        self.still = previous.still & same
        self.reference, self.reference_generations = previous.reference, previous.reference_generations.copy()

    def forget(self) -> None:
        """Drop all that was kept, as after a reset."""
        self.static_tiles, self.reference, self.pending = StaticTiles(), None, None
        self.matched[:], self.still[:] = 0, False

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return copies for `load`."""
        arrays = self.static_tiles.arrays()
        if arrays:
            arrays |= {"still.matched": self.matched.copy(), "still.tiles": self.still.copy()}
        if self.reference is not None:
            arrays["still.looks"] = pixels = self.reference.pixels.copy()
            arrays["still.looked"] = reference_generations = (
                self.reference_generations == self.reference.generations
            )
            if self.pending is not None:
                reference_generations |= self.pending.tiles
                for y0, y1, x0, x1 in scaled(runs_of(self.pending.tiles), TILE, pixels.shape[1::-1]):
                    pixels[y0:y1, x0:x1] = self.pending.image[y0:y1, x0:x1, :3]
        return arrays

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from arrays by `arrays`, of the shapes of `tile_state_specs`; the image is loaded apart.

        Raises:
            ArgumentError: they contradict each other.
        """
        self.generations[:] = next_generation()
        self.static_tiles = StaticTiles.of_arrays(arrays)
        if "still.matched" in arrays:
            self.matched, self.still = arrays["still.matched"].copy(), arrays["still.tiles"].copy()
        if "still.looks" in arrays:
            self.reference_generations = np.where(arrays["still.looked"], next_generation(), 0)
            self.reference = ReferenceTiles(arrays["still.looks"].copy(), self.reference_generations.copy())


def tile_state_specs(names: Collection[str], display: Size, render: Size) -> dict[str, ArraySpec]:
    """Return the shapes and values that arrays by `TileState.arrays` must have; none without such a name.

    Args:
        names: of arrays, of any origin.
        display: size of the image.
        render: size of the last frame.
    """
    reference, still = {"still.looks", "still.looked"}, {name for name in names if name.startswith("still.")}
    if not still:
        return {}
    tiles = tuple(-(-extent // TILE) for extent in display[::-1])
    specs = static_tile_specs(render)
    specs["still.matched"] = ArraySpec("int32", tiles, (0, np.iinfo(np.int32).max))
    specs["still.tiles"] = ArraySpec("bool", tiles)
    if reference & still:
        specs["still.looks"] = ArraySpec("float32", (*display[::-1], 3), values_of("still.looks"))
        specs["still.looked"] = ArraySpec("bool", tiles)
    return specs


class Pending(NamedTuple):
    """Tiles of a history's image, to be copied.

    Attributes:
        tiles: (rows, columns) which.
        image: (H, W, 3 or more) linear RGB in the first channels.
    """

    tiles: Bool
    image: NDArray[Any]


@dataclass(eq=False)
class ReferenceTiles:
    """Earlier pixels of tiles.

    Attributes:
        pixels: (H, W, 3) linear RGB.
        generations: (rows, columns) of the pixels of each tile.
    """

    pixels: Float32
    generations: NDArray[np.int64]
