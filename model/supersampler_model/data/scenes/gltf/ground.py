"""Free floor space on a stage, computed from its triangles: any file can be a stage."""

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.gltf.document import Integers
from supersampler_model.data.scenes.scene import Instance, Values

CELLS = 160  # along the longer side of a stage
STEP, HEADROOM = 0.25, 2.0  # metres: height of a level, and free height above a floor
_SAMPLES = 2_000_000  # of the triangles
_TRIES = 64  # of positions near another


class Ground:
    """A map of a stage, seen from above.

    Attributes:
        cell: side of a cell, metres.
        free: (nx, nz) True where a cell and the cells around it have a floor and headroom.
    """

    def __init__(self, triangles: Values) -> None:
        """Build the map from (m, 3, 3) triangles, metres, y up; outliers are ignored."""
        low, high = np.percentile(triangles.reshape(-1, 3), (1, 99), axis=0)
        room = np.maximum(0.1 * (high - low), 2.0)
        self._origin = np.maximum(low - room, triangles.min(axis=(0, 1)) - 0.5 * STEP)
        extent = np.minimum(high + room, triangles.max(axis=(0, 1)) + STEP) - self._origin
        self.cell = max(STEP, float(extent[[0, 2]].max()) / CELLS)
        self._climb = max(1, int(self.cell / STEP))  # levels from a cell to the next that are not a wall
        sides = np.array([self.cell, STEP, self.cell])
        counts = np.ceil(extent / sides).astype(int).clip(1, (CELLS + 1, 400, CELLS + 1))
        counts[1] += int(HEADROOM / STEP)
        points, flat = _samples(triangles, self.cell)
        boxes = np.floor((points - self._origin) / sides).astype(np.int64)
        inside = ((boxes >= 0) & (boxes < counts)).all(axis=1)
        filled, level = np.zeros(counts, bool), np.zeros(counts, bool)
        filled[tuple(boxes[inside].T)] = True
        level[tuple(boxes[inside & flat].T)] = True
        self._levels = _standing(filled, level)
        self._heights = _heights(points[inside & flat, 1], boxes[inside & flat], self._levels)
        self.free = self._roomy(self._levels)
        self._cells_free = np.argwhere(self.free)

    def take(self, place: Values, radius: float) -> None:
        """Exclude the surroundings of an object from `spot` and `near`, unless no other cell is free."""
        away = np.hypot(*(self._centers() - place[[0, 2]]).T)
        if (away > radius).any():
            self._cells_free = self._cells_free[away > radius]

    def spot(self, rng: np.random.Generator) -> Values:
        """Return a random position (3,) on the free floor."""
        cells = self._cells_free
        return self._place(cells[rng.integers(len(cells))] + rng.uniform(0.0, 1.0, 2))

    def near(self, rng: np.random.Generator, place: Values, minimum: float, maximum: float) -> Values:
        """Return a position at a distance in [minimum, maximum] from `place`, with free floor between.

        Where there is none, return the one closest to that range.
        """
        off = np.abs(_outside(np.hypot(*(self._centers() - place[[0, 2]]).T), minimum, maximum))
        close = self._cells_free[off <= max(float(off.min()), 0.5 * self.cell)]
        candidates = close[rng.integers(len(close), size=_TRIES)] + rng.random((_TRIES, 2))
        found = [self._place(cell) for cell in candidates]
        distances = [np.hypot(*(other - place)[[0, 2]]) for other in found]
        order = np.argsort(np.abs(_outside(np.array(distances), minimum, maximum)), kind="stable")
        found = [found[index] for index in order]
        return next((other for other in found if self.clear(other, place)), found[0])

    def clear(self, a: Values, b: Values) -> bool:
        """Return whether the straight line between two positions runs over free floor without steps."""
        steps = int(np.ceil(2.0 * np.hypot(*(b - a)[[0, 2]]) / self.cell)) + 1
        line = a + np.linspace(0.0, 1.0, steps)[:, None] * (b - a)
        x, z = self._cells(line[:, [0, 2]])
        levels = self._levels[x, z]
        return bool(self.free[x, z].all() and (np.abs(np.diff(levels)) <= self._climb).all())

    def stretch(
        self, rng: np.random.Generator, place: Values, away: float, minimum: float, maximum: float
    ) -> tuple[Values, Values]:
        """Return two positions near another, [minimum, maximum] metres apart, or closer in a nook."""
        start = self.near(rng, place, 0.0, away)
        end = self.near(rng, start, minimum, maximum)
        if not self.clear(start, end) or np.hypot(*(end - start)[[0, 2]]) < 0.1:
            angle = rng.uniform(0.0, 2.0 * np.pi)  # a free cell has some room on each side
            end = start + 0.5 * np.array([np.cos(angle), 0.0, np.sin(angle)])
        return start, end

    def _centers(self) -> Values:
        """Return the middles (n, 2) in x and z of the cells to choose from."""
        return np.asarray(self._origin[[0, 2]] + (self._cells_free + 0.5) * self.cell)

    def _cells(self, places: Values) -> tuple[Integers, Integers]:
        cells = np.floor((places - self._origin[[0, 2]]) / self.cell).astype(np.int64)
        x, z = cells.clip(0, np.array(self.free.shape) - 1).T
        return x, z

    def _place(self, cell: Values) -> Values:
        x, z = self._origin[[0, 2]] + cell * self.cell
        return np.array([x, self._heights[int(cell[0]), int(cell[1])], z])

    def _roomy(self, levels: Integers) -> NDArray[np.bool_]:
        """Return the cells near the most common level that are surrounded by such cells."""
        standing = levels[levels >= 0]
        if not len(standing):
            return np.zeros(levels.shape, bool)
        usual = int(np.bincount(standing).argmax())
        hills = max(1, int(8.0 * (self.cell - STEP) / STEP))  # levels; large stages have hills
        free = (levels >= 0) & (np.abs(levels - usual) <= hills)
        lower, upper = (np.pad(np.where(free, levels, value), 1, mode="edge") for value in (1 << 20, -1))
        n, m = free.shape
        around = [(slice(i, i + n), slice(j, j + m)) for i in range(3) for j in range(3)]
        rise = np.max([upper[at] for at in around], axis=0) - np.min([lower[at] for at in around], axis=0)
        free &= rise <= 2 * self._climb
        for _ in range(max(1, round(0.5 / self.cell))):
            padded = np.pad(free, 1)
            free = np.all([padded[at] for at in around], axis=0)
        return _large(free)


def _outside(values: Values, minimum: float, maximum: float) -> Values:
    """Return the signed distance from values to a range; 0 inside."""
    return np.asarray(np.clip(values, minimum, maximum) - values)


def ground_of(instances: tuple[Instance, ...]) -> Ground | None:
    """Return the free floor of a stage; None if there is none."""
    triangles = triangles_of(instances)
    ground = Ground(triangles) if len(triangles) else None
    return ground if ground is not None and ground.free.any() else None


def triangles_of(instances: tuple[Instance, ...]) -> Values:
    """Return the triangles (m, 3, 3) of rigid meshes in the world, counter-clockwise from their front."""
    parts = [np.zeros((0, 3, 3))]
    for instance in instances:
        if instance.mesh.skin is None:
            model = instance.model
            moved = instance.mesh.positions.astype(np.float64) @ model[:3, :3].T + model[:3, 3]
            corners = moved[instance.mesh.indices]
            turned = np.full(len(corners), np.linalg.det(model[:3, :3]) < 0.0)
            if instance.material.double_sided:  # then all may face up
                turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 1] < 0.0
            parts.append(np.where(turned[:, None, None], corners[:, ::-1], corners))
    return np.concatenate(parts)


def _samples(triangles: Values, cell: float) -> tuple[Values, NDArray[np.bool_]]:
    """Return points (n, 3) on the triangles, eight per cell, and which of them one can stand on."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normals = np.cross(b - a, c - a)
    areas = 0.5 * np.linalg.norm(normals, axis=1)
    counts = np.minimum(8.0 * areas / cell**2, 8.0 * CELLS**2)  # a huge triangle is mostly outside
    thinning = min(1.0, _SAMPLES / max(float(counts.sum()), 1e-9))
    owner = np.repeat(np.arange(len(areas)), np.ceil(thinning * counts).astype(int))
    u, v = np.random.default_rng(0).random((2, len(owner), 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    points = a[owner] + u * (b - a)[owner] + v * (c - a)[owner]
    return points, (normals[:, 1] > 1.4 * areas)[owner]  # that faces up, within 45 degrees


def _heights(y: Values, boxes: Integers, levels: Integers) -> Values:
    """Return the mean height (nx, nz) of the level points in the boxes that one can stand on."""
    x, level, z = boxes.T
    on = levels[x, z] == level
    cells = np.ravel_multi_index((x[on], z[on]), levels.shape)
    sums, counts = (np.bincount(cells, weights, levels.size) for weights in (y[on], None))
    return np.asarray((sums / np.maximum(counts, 1)).reshape(levels.shape))


def _standing(filled: NDArray[np.bool_], level: NDArray[np.bool_]) -> Integers:
    """Return the lowest level (nx, nz) with headroom above it, -1 where there is none."""
    above = np.zeros(filled.shape, bool)
    for step in range(1, int(HEADROOM / STEP)):
        above[:, :-step] |= filled[:, step:]
    possible = level & ~above
    return np.where(possible.any(axis=1), possible.argmax(axis=1), -1).astype(np.int64)


def _large(free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the connected regions of at least a tenth of the size of the largest; others are in objects."""
    numbers = np.where(free, np.arange(1, free.size + 1).reshape(free.shape), 0)
    before = np.zeros_like(numbers)
    while (numbers != before).any():  # each cell takes the largest number in its region
        before, padded = numbers, np.pad(numbers, 1)
        cross = [padded[2:, 1:-1], padded[:-2, 1:-1], padded[1:-1, 2:], padded[1:-1, :-2], numbers]
        numbers = np.where(free, np.max(cross, axis=0), 0)
    sizes = np.bincount(numbers.ravel())[numbers]
    return np.asarray(free & (10 * sizes >= sizes[free].max(initial=0)))
