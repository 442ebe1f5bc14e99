"""Family of test shots with thin objects: a ship's rigging, chains, chain-link, power lines."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.paths import along, placed, turned_by
from supersampler_model.data.scenes.procedural.shapes import Part, Point
from supersampler_model.data.scenes.procedural.stage import WHEEL, Stage, bulb, hills
from supersampler_model.data.scenes.scene import Mesh, Rng, Values

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
    x = MASTS[-1][0]
    boom, gaff = (x + 5.2, 3.2, 0.0), (x + 4.0, 6.6, 0.0)  # their ends
    spars = [_spar((*BOW, 0.0), (*BOWSPRIT, 0.0), 0.14, 0.06), _spar((x, 4.6, 0.0), gaff, 0.08, 0.05)]
    spars.append(_spar((x, 3.0, 0.0), boom, 0.09, 0.06))
    hemp: list[Mesh] = [rope(gaff, boom, 0.014), rope(gaff, (x, 9.0, 0.0), 0.014)]
    sails = []
    for (x, height), after in pairwise((*MASTS, (8.6, 0.0))):
        platform = (shapes.box(1.0, 0.07, 1.4), placed(x, TOP * height))
        spars += [_spar((x, DECK, 0.0), (x, height, 0.0), 0.17, 0.06), platform]
        braced = rng.uniform(0.25, 0.55)
        for level, half in YARDS:
            yard = _Yard(x, level * height, half, braced)
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


KEEL, EDGE, SHORE = -8.5, -4.0, -24.0  # z of the ship, of the quay's edge, of the other bank
WATER = -0.7  # its height
ARMS = ((10.0, 2.6), (11.6, 2.0))  # of pylons: height, length to each side


def rigging(rng: Rng) -> Stage:
    """Build a ship at a quay with a fence, and power lines behind it, by day."""
    sky = lighting.outdoors(rng, (0.16, 0.33, 0.75), (0.62, 0.68, 0.78), (0.12, 0.13, 0.12), clouds=1.0)
    stage = Stage(environment=sky, exposure=0.7)
    clouds = lighting.maybe(rng, 0.5, lighting.clouds)
    stage.sun = lighting.sunlight(
        rng, 6.5, 15.0, elevation=(28.0, 55.0), azimuth=(3.9, 5.5), pulsing=clouds, center=(0.0, 0.0, -6.0)
    )
    _banks(rng, stage)
    ship(rng, stage, KEEL)
    _fence(rng, stage)
    _chains(rng, stage)
    _power_lines(rng, stage)
    _boat(rng, stage)
    _cart(rng, stage)
    _gulls(rng, stage)
    _lights(rng, stage)
    stage.add_vantages(
        ((-3.2, 1.9, 4.6), (-2.4, 4.4, KEEL), 2.0), ((-6.5, 3.0, 2.5), (0.5, 5.0, KEEL), 1.5),
        ((3.4, 1.7, 3.0), (-0.6, 4.8, KEEL), 2.5),
    )  # fmt: skip
    return stage


def _banks(rng: Rng, stage: Stage) -> None:
    quay = shapes.box(60.0, 1.0, 20.0, 0.4)
    stage.put(quay, materials.tiles(rng, 8, 0.1, 0.3), placed(0, -1.0, EDGE + 10.0))
    stage.put(shapes.box(60.0, 0.12, 0.35, 0.5), materials.concrete(rng), placed(0, 0, EDGE + 0.2))
    water = materials.metal(rng, (0.16, 0.22, 0.25), 0.16, 0.1)
    stage.put(shapes.plane(140.0, 60.0, 0.1), water, placed(0, WATER, -30.0))
    meadow = materials.ground(rng, (0.3, 0.33, 0.2))
    stage.put(shapes.box(140.0, 1.2, 30.0, 0.3), meadow, placed(0, -0.9, SHORE - 15.0))
    hills(rng, stage, (0.27, 0.33, 0.24))


def _fence(rng: Rng, stage: Stage) -> None:
    """Add chain-link on the right, under barbed wire."""
    left, right, z, height = 0.6, 12.6, 0.2, 2.2
    mesh = shapes.wall(right - left, height, 0.7)
    stage.put(mesh, materials.fence(rng, 16), placed(0.5 * (left + right), 0.05, z))
    xs = np.arange(left, right + 0.1, 2.0)
    parts: list[Part] = [(shapes.cylinder(0.035, height + 0.5, 10), placed(x, 0, z)) for x in xs]
    parts += [shapes.tube([(left, y, z), (right, y, z)], 0.02) for y in (0.08, height)]
    ends = [(x, next_x, y) for x, next_x in pairwise(xs) for y in (2.35, 2.5, 2.65)]
    parts += [shapes.wire((x, y, z), (next_x, y, z), 0.03, 0.005) for x, next_x, y in ends]
    stage.put(parts, materials.metal(rng, (0.55, 0.55, 0.56), 0.35))


def _chains(rng: Rng, stage: Stage) -> None:
    """Add chains from post to post along the quay, the anchor's chain, and mooring lines."""
    iron, posts = materials.metal(rng, (0.4, 0.39, 0.38), 0.4), np.arange(-14.5, 14.6, 2.4)
    z = EDGE + 0.5
    stage.put([(shapes.cylinder(0.07, 0.95, 10), placed(x, 0, z)) for x in posts], materials.paint(rng))
    links: list[Part] = []
    for x, next_x in pairwise(posts):
        links += _chain((x, 0.9, z), (next_x, 0.9, z), rng.uniform(0.25, 0.4), 0.09)
    bow = (BOW[0], 1.6, KEEL + 0.6)
    stage.put([*links, *_chain(bow, (BOW[0] - 1.6, WATER, KEEL + 1.2), 0.1, 0.13)], iron)
    bollard = shapes.lathe([(0.14, 0.0), (0.12, 0.3), (0.2, 0.36), (0.2, 0.42), (0.0, 0.46)], 16)
    bollards = [(x, 0.3, EDGE + 0.2) for x in (-10.5, -4.0, 3.6, 10.0)]
    stage.put([(bollard, placed(x, 0.1, z)) for x, _, z in bollards], iron)
    hull = [(x, 1.9, KEEL + 0.9 * HALF_WIDTH) for x in (-5.5, -1.0, 1.5, 5.0)]
    lines = [shapes.wire(a, b, rng.uniform(0.1, 0.3), 0.02) for a, b in zip(hull, bollards, strict=True)]
    stage.put(lines, materials.cloth(rng, (0.7, 0.62, 0.45)))


def _chain(start: Point, end: Point, sag: float, pitch: float) -> Iterable[Part]:
    """Yield the links of a hanging chain, one every `pitch` metres; adjacent links are at right angles."""
    turn = np.linspace(0.0, 2.0 * np.pi, 8)
    oval = pitch * np.stack([0.42 * np.sin(turn), 0.68 * np.cos(turn), 0.0 * turn], axis=1)
    link = shapes.tube(oval, 0.15 * pitch, 4)
    t = np.linspace(0.0, 1.0, round(1.1 * np.linalg.norm(np.subtract(end, start)) / pitch))[:, None]
    points = (1.0 - t) * start + t * np.asarray(end)
    points[:, 1:2] -= 4.0 * sag * t * (1.0 - t)
    for number, (here, there) in enumerate(pairwise(points)):
        yield link, along(0.5 * (here + there), there - here, roll=0.5 * np.pi * (number % 2))


def _power_lines(rng: Rng, stage: Stage) -> None:
    """Add pylons on the other bank, and five lines on them."""
    xs, z = np.arange(-44.0, 45.0, 22.0) + rng.uniform(-4.0, 4.0), SHORE - 3.0
    ends = [*((y - 0.4, side) for y, out in ARMS for side in (-out, out)), (12.6, 0.0)]
    spans = [(x, next_x, y, z + side) for x, next_x in pairwise(xs) for y, side in ends]
    lines = [shapes.wire((x, y, away), (next_x, y, away), 1.1, 0.02) for x, next_x, y, away in spans]
    pylon = shapes.merged(_pylon(13.0))
    stage.put([(pylon, placed(x, 0, z)) for x in xs], materials.metal(rng, (0.5, 0.52, 0.53), 0.5))
    stage.put(lines, materials.paint(rng, (0.05, 0.05, 0.05), 0.3))


def _pylon(height: float) -> Iterable[Part]:
    """Yield the bars of a lattice mast whose arms point to both sides, along z."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    levels = height * (1.0 - np.array([1.0, 0.8, 0.62, 0.46, 0.32, 0.2, 0.1, 0.0]))
    half = 0.25 + 1.15 * (1.0 - levels / height) ** 1.5
    rings = [[(h * x, y, h * z) for x, z in corners] for y, h in zip(levels, half, strict=True)]
    for below, above in pairwise(rings):
        for k in range(4):
            yield rope(below[k], above[k], 0.06)
            yield rope(below[k], above[(k + 1) % 4], 0.03)
            yield rope(below[(k + 1) % 4], above[k], 0.03)
    for y, out in ARMS:
        for side in (-out, out):
            yield rope((0.0, y, 0.0), (0.0, y, side), 0.05)
            yield rope((0.0, y + 0.9, 0.0), (0.0, y, side), 0.03)
            yield rope((0.0, y, side), (0.0, y - 0.4, side), 0.04)


def _boat(rng: Rng, stage: Stage) -> None:
    """Add a sailing boat that passes behind the ship."""
    z = rng.uniform(-17.0, -14.0)
    pose = paths.upright(paths.swing(rng, (-16.0, WATER, z), (16.0, WATER, z), rng.uniform(5.0, 9.0)))
    hull = shapes.lathe([(0.6, -0.3), (1.0, 0.55), (0.9, 0.6), (0.0, 0.4)], 24)
    stage.put([(hull, placed(size=(3.4, 1.0, 1.0)))], materials.paint(rng), pose)
    head, tack, clew, bow = (0.5, 9.8, 0.0), (0.5, 1.5, 0.0), (-3.0, 1.5, 0.0), (3.3, 0.6, 0.0)
    corners, facing = np.array([head, tack, clew]), np.tile([0.0, 0.0, 1.0], (3, 1))
    sail = shapes.mesh_of(corners, facing, np.array([(0, 0), (0, 1), (1, 1)]), np.array([[0, 1, 2]]))
    stage.put(sail, materials.cloth(rng, (0.9, 0.88, 0.82)), pose)
    stays = [rope(head, bow, 0.012), rope(head, (-3.3, 0.6, 0.0), 0.012), rope(head, (0.5, 0.6, 0.9), 0.012)]
    spars = [rope((0.5, 0.4, 0.0), head, 0.06), rope(tack, clew, 0.04)]
    stage.put([*stays, *spars], materials.metal(rng, (0.8, 0.8, 0.8), 0.3), pose)


def _cart(rng: Rng, stage: Stage) -> None:
    """Add a cart that drives on the quay behind the fence."""
    z = rng.uniform(-2.6, -1.4)
    pose = paths.headed(paths.swing(rng, (-9.0, 0.0, z), (9.0, 0.0, z), rng.uniform(3.0, 5.0)))
    bed, back, wheel = shapes.box(0.9, 0.35, 1.6), shapes.box(0.8, 0.9, 0.1), shapes.torus(0.2, 0.08, 20)
    stage.put([(bed, placed(0, 0.3, 0)), (back, placed(0, 0.65, -0.7))], materials.paint(rng), pose)
    feet = [(x, z) for x in (-0.42, 0.42) for z in (-0.6, 0.0, 0.6)]
    rails = [shapes.tube([(x, 0.65, z), (x, 1.5, z)], 0.015, 6) for x, z in feet]
    stage.put(rails, materials.metal(rng, (0.7, 0.7, 0.7), 0.3), pose)
    wheels = [(wheel, placed(x, 0.28, z) @ WHEEL) for x in (-0.5, 0.5) for z in (-0.55, 0.55)]
    stage.put(wheels, materials.paint(rng, (0.05, 0.05, 0.05), 0.2), pose)


def _gulls(rng: Rng, stage: Stage) -> None:
    white = materials.plaster(rng, (0.88, 0.88, 0.86))
    spans = ([(0, 0, 0), (side * 0.3, 0.12, -0.03), (side * 0.65, 0.05, -0.12)] for side in (-1, 1))
    wings = [shapes.tube(span, 0.035, 5) for span in spans]
    bird = shapes.merged([*wings, (shapes.ball(0.08, 6), placed(size=(1.0, 1.0, 2.6)))])
    for _ in range(5):
        home = (rng.uniform(-6.0, 6.0), rng.uniform(6.0, 12.0), rng.uniform(-12.0, -4.0))
        path = paths.circuit(rng, home, (rng.uniform(2, 5), 2.5), rng.uniform(3.0, 6.0))
        stage.put(bird, white, paths.headed(path))


def _lights(rng: Rng, stage: Stage) -> None:
    """Add lamps on a cable over the quay, and a lantern at the ship's stern."""
    z = EDGE + 1.0
    masts = (-11.0, -3.6, 4.4, 12.0)
    poles = [(shapes.cylinder(0.05, 4.3, 8), placed(x, 0, z)) for x in masts]
    stage.put(poles, materials.paint(rng, (0.2, 0.22, 0.22)))
    for x, next_x in pairwise(masts):
        cable = shapes.wire((x, 4.25, z), (next_x, 4.25, z), 0.5, 0.011)
        stage.put(cable, materials.paint(rng, (0.06, 0.06, 0.06)))
        color = lighting.tint(rng, rng.uniform(14.0, 28.0), rng.uniform(0.2, 0.8))
        pulsing = lighting.maybe(rng, 0.6, lighting.nervous)
        bulb(stage, (0.5 * (x + next_x), 3.62, z), color, size=0.11, reach=9.0, pulsing=pulsing)
    color, pulsing = lighting.tint(rng, 9.0, 0.9), lighting.pulse(rng, "throb")
    bulb(stage, (9.3, 3.4, KEEL), color, size=0.12, pulsing=pulsing)
