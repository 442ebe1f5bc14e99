"""Where there is room on a stage: found by looking through its triangles, so that any file can be one."""

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.gltf.accessors import Integers, Values

CELLS = 160  # along the longer side
STEP, HEADROOM = 0.25, 2.0  # metres: of levels, and above one that somebody stands on
_SAMPLES = 2_000_000
_TRIES = 64


class Ground:
    """A map of a stage, from above.

    Attributes:
        cell: its cells' side, metres.
        free: (nx, nz) True where there is a floor, headroom, and the same in the cells around.
    """

    def __init__(self, triangles: Values) -> None:
        """Look through (m, 3, 3) triangles, metres, y up; what is far from nearly all of them is left out."""
        low, high = np.percentile(triangles.reshape(-1, 3), (1, 99), axis=0)
        room = np.maximum(0.1 * (high - low), 2.0)
        self._origin = np.maximum(low - room, triangles.min(axis=(0, 1)) - 0.5 * STEP)
        extent = np.minimum(high + room, triangles.max(axis=(0, 1)) + STEP) - self._origin
        self.cell = max(STEP, float(extent[[0, 2]].max()) / CELLS)
        self._climb = max(1, int(self.cell / STEP))  # levels from a cell to the next that are no wall
        sides = np.array([self.cell, STEP, self.cell])
        counts = np.ceil(extent / sides).astype(int).clip(1, (CELLS + 1, 400, CELLS + 1))
        counts[1] += int(HEADROOM / STEP)
        filled, level = self._voxels(triangles, sides, counts)
        self._levels = _standing(filled, level)
        self.free = self._roomy(self._levels)

    def spot(self, rng: np.random.Generator) -> Values:
        """Return a place (3,) on the ground."""
        cells = np.argwhere(self.free)
        return self._place(cells[rng.integers(len(cells))] + rng.uniform(0.0, 1.0, 2))

    def near(self, rng: np.random.Generator, place: Values, least: float, most: float) -> Values:
        """Return a place between these distances from another, with nothing between them if there is one."""
        found = [self.spot(rng) for _ in range(4 * _TRIES)]
        away = [
            abs(np.clip(d, least, most) - d) for d in (float(np.hypot(*(p - place)[[0, 2]])) for p in found)
        ]
        order = np.argsort(away, kind="stable")[:_TRIES]
        return next(
            (found[i] for i in order if away[i] == 0.0 and self.clear(found[i], place)), found[order[0]]
        )

    def clear(self, a: Values, b: Values) -> bool:
        """Return whether one can walk straight from one place to another."""
        steps = int(np.ceil(2.0 * np.hypot(*(b - a)[[0, 2]]) / self.cell)) + 1
        line = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
        x, z = self._cells(line[:, [0, 2]])
        levels = self._levels[x, z]
        return bool(self.free[x, z].all() and (np.abs(np.diff(levels)) <= self._climb).all())

    def _cells(self, places: Values) -> tuple[Integers, Integers]:
        cells = np.floor((places - self._origin[[0, 2]]) / self.cell).astype(np.int64)
        x, z = cells.clip(0, np.array(self.free.shape) - 1).T
        return x, z

    def _place(self, cell: Values) -> Values:
        x, z = self._origin[[0, 2]] + cell * self.cell
        level = self._levels[int(cell[0]), int(cell[1])]
        return np.array([x, self._origin[1] + (level + 0.5) * STEP, z])

    def _voxels(
        self, triangles: Values, sides: Values, counts: NDArray[np.int_]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which boxes (nx, ny, nz) hold surface, and which of them a level one."""
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        normals = np.cross(b - a, c - a)
        areas = 0.5 * np.linalg.norm(normals, axis=1)
        wanted = np.minimum(8.0 * areas / self.cell**2, 8.0 * CELLS**2)  # a huge one lies outside, mostly
        shortage = min(1.0, _SAMPLES / max(float(wanted.sum()), 1e-9))
        of = np.repeat(np.arange(len(areas)), np.ceil(shortage * wanted).astype(int))
        u, v = np.random.default_rng(0).random((2, len(of), 1))
        u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
        points = a[of] + u * (b - a)[of] + v * (c - a)[of]
        boxes = np.floor((points - self._origin) / sides).astype(np.int64)
        inside = ((boxes >= 0) & (boxes < counts)).all(axis=1)
        flat = (np.abs(normals[:, 1]) > 1.4 * areas)[of] & inside  # within 45 degrees of level
        filled, level = np.zeros(counts, bool), np.zeros(counts, bool)
        filled[tuple(boxes[inside].T)] = True
        level[tuple(boxes[flat].T)] = True
        return filled, level

    def _roomy(self, levels: Integers) -> NDArray[np.bool_]:
        """Return the cells near the commonest level, with others around them."""
        standing = levels[levels >= 0]
        if not len(standing):
            return np.zeros(levels.shape, bool)
        usual = int(np.bincount(standing).argmax())
        free = np.abs(levels - usual) <= max(1, int(8.0 * (self.cell - STEP) / STEP))  # large ones have hills
        lower, upper = (np.pad(np.where(free, levels, value), 1, mode="edge") for value in (1 << 20, -1))
        n, m = free.shape
        around = [(slice(i, i + n), slice(j, j + m)) for i in range(3) for j in range(3)]
        rise = np.max([upper[at] for at in around], axis=0) - np.min([lower[at] for at in around], axis=0)
        free &= rise <= 2 * self._climb
        for _ in range(max(1, round(0.5 / self.cell))):
            padded = np.pad(free, 1)
            free = np.all([padded[at] for at in around], axis=0)
        return _large(free)


def _standing(filled: NDArray[np.bool_], level: NDArray[np.bool_]) -> Integers:
    """Return the lowest level (nx, nz) with headroom above it, -1 where there is none."""
    above = np.zeros(filled.shape, bool)
    for step in range(1, int(HEADROOM / STEP)):
        above[:, :-step] |= filled[:, step:]
    possible = level & ~above
    return np.where(possible.any(axis=1), possible.argmax(axis=1), -1).astype(np.int64)


def _large(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the connected regions, without those of less than a tenth of the largest: hollow things."""
    left, regions = set(map(tuple, np.argwhere(free).tolist())), []
    while left:
        region, waiting = [], [left.pop()]
        while waiting:
            x, z = waiting.pop()
            region.append((x, z))
            around = {(x - 1, z), (x + 1, z), (x, z - 1), (x, z + 1)} & left
            left -= around
            waiting += around
        regions.append(region)
    kept = np.zeros(free.shape, bool)
    largest = max(map(len, regions), default=0)
    for region in regions:
        if 10 * len(region) >= largest:
            kept[tuple(np.array(region).T)] = True
    return kept
