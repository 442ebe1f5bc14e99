"""A square-rigged ship: hull, masts and yards, standing rigging of tarred rope, running rigging of hemp."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.procedural import materials, shapes
from supersampler_model.data.scenes.procedural.shapes import Part, Point
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import along, placed, turned_by
from supersampler_model.data.values import Rng, Values

HALF_LENGTH, HALF_WIDTH = 9.5, 2.3
DECK, RAIL = 1.7, 2.3  # heights
MASTS = ((-5.4, 12.5), (0.2, 14.0), (5.4, 10.5))  # x, height
TOP = 0.56  # where shrouds meet a mast, fraction of its height
YARDS = ((0.42, 3.3), (0.63, 2.6), (0.83, 1.8))  # fraction of the mast's height, half length
BOW, BOWSPRIT = (-8.2, 2.2), (-13.0, 4.1)  # x, y of the ends of the bowsprit


def ship(rng: Rng, stage: Stage, keel: float) -> None:
    """Add a ship whose keel lies along x at z = `keel` and whose bow points to -x."""
    at = placed(0.0, 0.0, keel)
    _hull(rng, stage, keel)
    spars, sails, hemp = _bowsprit_and_gaff(), [], _gaff_ropes()
    for mast, after in pairwise((*MASTS, (8.6, 0.0))):
        spars += _mast(*mast)
        braced = rng.uniform(0.25, 0.55)
        for level, half in YARDS:
            yard = _Yard(mast[0], level * mast[1], half, braced)
            spars += yard.spars()
            sails.append(yard.furled_sail())
            hemp += yard.ropes(rng, after)
    stage.put(spars, materials.planks(rng, 4), at)
    stage.put(sails, materials.cloth(rng, (0.86, 0.82, 0.72)), at)
    stage.put(_standing_rigging(), materials.paint(rng, (0.09, 0.08, 0.07), 0.1), at)
    stage.put(hemp, materials.cloth(rng, (0.66, 0.54, 0.36)), at)


def rope(start: Point, end: Point, radius: float) -> Mesh:
    """Return a taut rope between two points."""
    return shapes.tube(np.stack([np.asarray(start), np.asarray(end)]), radius, 5)


def _hull(rng: Rng, stage: Stage, keel: float) -> None:
    def shell(*profile: tuple[float, float]) -> Part:
        return shapes.lathe(profile, 40), placed(0.0, 0.0, keel, size=(HALF_LENGTH, 1.0, HALF_WIDTH))

    outside = [shell((0.7, -1.2), (0.93, 0.0), (1.0, 1.0)), shell((1.0, 1.4), (1.0, RAIL), (0.97, RAIL))]
    stage.put(outside, materials.paint(rng, (0.12, 0.1, 0.09), 0.4))
    stage.put([shell((1.0, 1.0), (1.01, 1.2), (1.0, 1.4))], materials.paint(rng, (0.82, 0.78, 0.66), 0.4))
    stage.put([shell((0.97, RAIL), (0.96, DECK), (0.0, DECK))], materials.planks(rng, 16))
    cabins = [(shapes.box(2.2, 1.3, 2.2, 0.6), placed(x, DECK, keel)) for x in (-2.8, 3.0, 7.2)]
    stage.put(cabins, materials.planks(rng))
    ring = shapes.torus(0.28, 0.07, 20)
    rings = [(ring, placed(x, 1.75, keel + HALF_WIDTH) @ turned_by(0, np.pi / 2.0)) for x in (-2.0, 2.4)]
    stage.put(rings, materials.paint(rng, (0.85, 0.3, 0.1)))


def _spar(start: Point, end: Point, radius: float, tip: float) -> Part:
    """Return a round timber that tapers from `radius` to `tip`."""
    toward = np.subtract(end, start)
    length = float(np.linalg.norm(toward))
    return shapes.lathe([(radius, 0.0), (tip, length), (0.0, length)], 10), along(np.asarray(start), toward)


def _mast(x: float, height: float) -> list[Part]:
    platform = (shapes.box(1.0, 0.07, 1.4), placed(x, TOP * height))
    return [_spar((x, DECK, 0.0), (x, height, 0.0), 0.17, 0.06), platform]


def _bowsprit_and_gaff() -> list[Part]:
    x = MASTS[-1][0]
    return [
        _spar((*BOW, 0.0), (*BOWSPRIT, 0.0), 0.14, 0.06),
        _spar((x, 4.6, 0.0), (x + 4.0, 6.6, 0.0), 0.08, 0.05),
        _spar((x, 3.0, 0.0), (x + 5.2, 3.2, 0.0), 0.09, 0.06),
    ]


def _gaff_ropes() -> list[Mesh]:
    x = MASTS[-1][0]
    peak = (x + 4.0, 6.6, 0.0)
    return [rope(peak, (x + 5.2, 3.2, 0.0), 0.014), rope(peak, (x, 9.0, 0.0), 0.014)]


def _standing_rigging() -> Iterable[Mesh]:
    """Yield shrouds, backstays, and the stays from mast to mast and to the bowsprit."""
    for x, height in MASTS:
        for side in (-HALF_WIDTH, HALF_WIDTH):
            yield from _shrouds(x, TOP * height, side)
            for aft in (1.6, 2.0):
                yield rope((x, 0.95 * height, 0.0), (x + aft, RAIL, side), 0.016)
    for (x, height), (next_x, next_height) in pairwise(MASTS):
        for low, high in ((0.2, TOP), (TOP, 0.93)):
            yield rope((x, low * height, 0.0), (next_x, high * next_height, 0.0), 0.02)
    x, height = MASTS[0]
    for high, out in ((TOP, 0.35), (0.75, 0.7), (0.95, 1.0)):
        end = np.add(BOW, out * np.subtract(BOWSPRIT, BOW))
        yield rope((x, high * height, 0.0), (*end, 0.0), 0.02)


def _shrouds(x: float, height: float, side: float) -> Iterable[Mesh]:
    """Yield five shrouds from the rail at z = `side` to a mast, and the ratlines across."""
    top = np.array([x, height, 0.0])
    feet = np.array([(x - 0.2 + 0.42 * k, RAIL, side) for k in range(5)])
    for foot in feet:
        yield rope(foot, top, 0.018)
    for up in np.arange(0.06, 0.9, 0.05):
        fore, aft = feet[[0, -1]] + up * (top - feet[[0, -1]])
        yield rope(fore, aft, 0.008)


class _Yard:
    """A yard across a mast, turned by `braced` radians from the keel's direction."""

    def __init__(self, x: float, height: float, half: float, braced: float) -> None:
        self._x, self._height, self._half = x, height, half
        self._extent = half * np.array([np.cos(braced), 0.0, np.sin(braced)])

    def at(self, part: float, below: float = 0.0) -> Values:
        """Return the point (3,) at `part` of the half length, in [-1, 1], and `below` it by some metres."""
        return np.array([self._x, self._height - below, 0.2]) + part * self._extent

    def spars(self) -> list[Part]:
        return [_spar(self.at(0.0), self.at(end), 0.1, 0.04) for end in (-1.0, 1.0)]

    def furled_sail(self) -> Mesh:
        lumps = [self.at(part, 0.14 + 0.05 * np.cos(9.0 * part)) for part in np.linspace(-0.9, 0.9, 15)]
        return shapes.tube(np.stack(lumps), 0.11)

    def ropes(self, rng: Rng, after: tuple[float, float]) -> Iterable[Mesh]:
        """Yield lifts, braces to the mast `after`, the footrope on its stirrups, and buntlines."""
        sag = 0.16 * self._half
        yield shapes.wire(self.at(-0.95), self.at(0.95), sag, 0.011)
        for end in (-0.95, 0.95):
            yield rope(self.at(end), (self._x, self._height + 1.1, 0.0), 0.012)
            yield rope(self.at(end), (after[0], max(0.35 * after[1], RAIL), 0.0), 0.012)
        for part in (-0.6, -0.2, 0.2, 0.6):
            yield rope(self.at(part), self.at(part, sag * (1.0 - (part / 0.95) ** 2)), 0.008)
            pin = (self._x + 0.6 * part, DECK + 0.8, rng.uniform(1.0, 2.0))
            yield rope(self.at(part), pin, 0.008)
