"""Tiles in which nothing but noise changes: their samples add up until more than noise changes.

A tile is compared with its mean by what its samples average to in each frame, as a screen shows it and in
depth. The standard deviation of these means is estimated from earlier frames. A frame far outside of it is
doubted, and the next one that is far off on the same side confirms it. Less is noticed when it adds up: the
cumulative sum of deviations (CUSUM, Page 1954) on either side passes a limit.
"""

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import STATIC_TILE, SUM_VALUES
from supersampler.backends.cpu.memory import aligned
from supersampler.frame import Float32, Size
from supersampler.methods.array_spec import LARGEST, ArraySpec

Bool = NDArray[np.bool_]
Float64 = NDArray[np.float64]

LEAST_DEVIATION = 1.0 / 1024.0
"""Least standard deviation of a frame's mean in a tile: of toned luma, and as a fraction of the depth."""
DOUBTED, CONFIRMED = 8.0, 4.0
"""Standard deviations from which on a frame is doubted, and from which on the next one confirms it."""
SLACK, LIMIT = 0.5, 16.0
"""Of the cumulative sums, standard deviations: noise alone passes the limit once in 10^7 frames of a tile."""
_COUNT, _MEAN, _SQUARES, _SUMS, _DOUBT = 0, slice(1, 3), slice(3, 5), slice(5, 9), slice(9, 11)
_VALUES = 11


class TileMeasures(NamedTuple):
    """What a frame's samples average to in tiles, (rows, columns).

    Attributes:
        seen: tiles with samples.
        moving: tiles in which a sample moves.
        values: (rows, columns, 2) means of toned luma and of depth.
        variance: likewise, estimated from the differences between samples.
    """

    seen: Bool
    moving: Bool
    values: Float64
    variance: Float64

    @classmethod
    def of_array(cls, measured: Float32) -> "TileMeasures":
        """Return the measures that kernels write, (rows, columns, 6)."""
        numbers = measured.astype(np.float64)
        return cls(measured[..., 0] > 0, measured[..., 5] > 0, numbers[..., 1:3], numbers[..., 3:5])


class NoisyTiles:
    """The accumulated samples of one history, and the statistics of its tiles.

    Args:
        display: size of the image.

    Attributes:
        exposure: that of the statistics; 0 before there are any.
        tiles: (rows, columns, 11) float64: number of frames in the sums; of luma and depth each the mean,
            the sum of squared differences from it, cumulative sums above and below, the doubted value or NaN.
        sums: (H, W, SUM_VALUES) sums over the samples in each pixel: weight times linear RGB, weight, 0.
        compensation: (H, W, 4) what rounding lost of these (Kahan 1965).
        doubted: tiles of which this frame is doubted.
    """

    def __init__(self, display: Size) -> None:
        shape = -(-display[1] // STATIC_TILE), -(-display[0] // STATIC_TILE)
        self.exposure, self.tiles = 0.0, np.zeros((*shape, _VALUES))
        self.sums = aligned((display[1], display[0], SUM_VALUES))
        self.compensation = aligned((display[1], display[0], 4))
        self.doubted = np.zeros(shape, bool)

    @property
    def counts(self) -> Float64:
        """Number of frames in the sums of each tile."""
        counts: Float64 = self.tiles[..., _COUNT]
        return counts

    def follow(self, previous: "NoisyTiles", exposure: float, measures: TileMeasures) -> None:
        """Continue from the previous state with a frame; the samples themselves are added by a kernel."""
        self.exposure, self.tiles = exposure, previous.tiles.copy()
        if exposure != previous.exposure:
            self.tiles[:] = 0.0
        tiles, (seen, moving, values, variance) = self.tiles, measures
        count, squares = tiles[..., _COUNT, None], tiles[..., _SQUARES]
        least = LEAST_DEVIATION * np.where([True, False], 1.0, tiles[..., _MEAN])
        deviation = np.maximum(np.sqrt(squares / np.maximum(count, 1.0)), np.maximum(least, 1e-12))
        off = (values - tiles[..., _MEAN]) / (deviation * np.sqrt(1.0 + 1.0 / np.maximum(count, 1.0)))
        doubt = tiles[..., _DOUBT].copy()
        known = (count > 0.0)[..., 0] & seen & ~moving
        side = np.sign(doubt - tiles[..., _MEAN])  # NaN without a doubt
        changed = known & (off * side > CONFIRMED).any(-1)
        doubted = known & ~changed & np.isnan(doubt).all(-1) & (np.abs(off) > DOUBTED).any(-1)
        keeps = known & ~changed & ~doubted
        limited = np.clip(off, -DOUBTED, DOUBTED)
        sums = np.maximum(tiles[..., _SUMS] + np.concatenate([limited, -limited], -1) - SLACK, 0.0)
        drifted = keeps & (sums > LIMIT).any(-1)
        keeps &= ~drifted
        tiles[..., _SUMS][keeps] = sums[keeps]
        for value, where in ((doubt, keeps & ~np.isnan(doubt).any(-1)), (values, keeps)):
            _add(tiles, value, where)
        tiles[..., _DOUBT] = np.where(doubted[..., None], values, np.where(seen[..., None], np.nan, doubt))
        begins = seen & ~moving & (~known | changed | drifted)
        tiles[moving | begins] = 0.0
        tiles[..., _DOUBT][moving | begins] = np.nan
        tiles[..., _COUNT][begins] = 1.0
        tiles[..., _MEAN][begins], tiles[..., _SQUARES][begins] = values[begins], variance[begins]
        self.doubted = doubted

    def errors(self, per_pixel: float) -> Float64:
        """Return the estimated standard error of a pixel's mean in each tile, toned; large without samples.

        Args:
            per_pixel: mean number of samples of a frame in a pixel.
        """
        count = np.maximum(self.counts, 1.0)
        variance = self.tiles[..., _SQUARES.start] / count * (STATIC_TILE**2 * per_pixel)
        errors: Float64 = np.where(self.counts > 1.0, np.sqrt(variance / (count * per_pixel)), np.inf)
        return errors

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return copies for `load`."""
        return {
            "static.noisy_exposure": np.array(self.exposure),
            "static.noisy_tiles": np.nan_to_num(self.tiles, nan=_NO_DOUBT),
            "static.noisy_sums": self.sums.copy(),
            "static.noisy_compensation": self.compensation.copy(),
        }

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from arrays by `arrays`, other arrays among them."""
        self.exposure = float(arrays["static.noisy_exposure"])
        tiles = arrays["static.noisy_tiles"]
        self.tiles[:] = np.where(tiles == _NO_DOUBT, np.nan, tiles)
        self.sums[:] = arrays["static.noisy_sums"]
        self.compensation[:] = arrays["static.noisy_compensation"]


_NO_DOUBT = -1e30


def _add(tiles: Float64, values: Float64, where: Bool) -> None:
    """Add values to the mean and the squares of tiles (Welford 1962)."""
    count = tiles[..., _COUNT][where] + 1.0
    before = values[where] - tiles[..., _MEAN][where]
    tiles[..., _MEAN][where] += before / count[:, None]
    tiles[..., _SQUARES][where] += before * (values[where] - tiles[..., _MEAN][where])
    tiles[..., _COUNT][where] = count


def noisy_tile_specs(names: Collection[str], display: Size) -> dict[str, ArraySpec]:
    """Return the shapes and values that arrays by `NoisyTiles.arrays` must have; none without such a name."""
    if not any(name.startswith("static.noisy_") for name in names):
        return {}
    tiles = tuple(-(-extent // STATIC_TILE) for extent in display[::-1])
    return {
        "static.noisy_exposure": ArraySpec("float64", (), (0.0, LARGEST)),
        "static.noisy_tiles": ArraySpec("float64", (*tiles, _VALUES), (_NO_DOUBT, 1e30)),
        "static.noisy_sums": ArraySpec("float32", (*display[::-1], SUM_VALUES), (0.0, LARGEST)),
        "static.noisy_compensation": ArraySpec("float32", (*display[::-1], 4), (-LARGEST, LARGEST)),
    }
