"""The shot that ships with the package: a camera walks across a small square, without cuts."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.procedural import lighting, materials, particles, paths, shapes
from supersampler_model.data.scenes.procedural.outdoors import bush, tree
from supersampler_model.data.scenes.procedural.paths import drift, placed, turned_by, vector
from supersampler_model.data.scenes.procedural.stage import Stage, bulb, bunting, skyline
from supersampler_model.data.scenes.scene import Camera, Color, Rng, Sun
from supersampler_model.data.sequences import Sequence, SequenceSpec
from supersampler_model.data.shots import ShotForm, render_shot

_CLOUD = 0.8  # seconds: when a cloud is halfway over the sun


def plaza(rng: Rng) -> Stage:
    """Build the square. The layout is fixed; `rng` varies textures and small irregularities."""
    sky = lighting.outdoors(rng, (0.2, 0.42, 0.95), (0.85, 0.74, 0.66), (0.16, 0.14, 0.12), clouds=1.3)
    stage = Stage(environment=sky, exposure=0.95)
    stage.sun = _sun
    stage.put(shapes.plane(60.0, 60.0, 0.8), materials.tiles(rng, 8, 0.35, 0.5))
    skyline(rng, stage)
    _houses(rng, stage)
    _fence(rng, stage)
    _fountain(rng, stage)
    _garden(rng, stage)
    for z, *heights in ((-1.6, 3.3, 3.0), (-4.2, 3.9, 3.6), (-6.6, 4.2, 4.4)):
        left, right = (-5.6, heights[0], z), (5.8, heights[1], z - 0.8)
        bunting(rng, stage, left, right, sag=0.55, cord=(0.009, 0.08), flags=22, margin=0.04, gap=0.12)
    _cart(rng, stage)
    _balls(rng, stage)
    _lights(rng, stage)
    motes = particles.dust(rng, (-4, 0, -6), (4, 3, 2), 140, color=(1.0, 0.8, 0.5), opacity=0.3)
    stage.particles += [motes, particles.smoke(rng, (2.9, 2.1, -4.6), grey=0.6)]
    return stage


def _sun(t: float) -> Sun:
    """Return a warm sun over the camera's left shoulder; a cloud covers it within a few frames."""
    through = 0.68 - 0.32 * float(np.tanh((t - _CLOUD) / 0.05))
    color = paths.vector(through * np.array([7.5, 5.9, 4.1]))
    return Sun(direction=(0.62, -0.55, -0.5), color=color, center=(0.0, 0.0, -3.5), radius=11.0)


def _houses(rng: Rng, stage: Stage) -> None:
    fronts: list[tuple[float, float, Color]] = [
        (-7.4, 5.2, (0.8, 0.62, 0.4)), (-3.6, 6.4, (0.72, 0.42, 0.34)), (0.2, 5.6, (0.52, 0.62, 0.66)),
        (4.0, 6.8, (0.82, 0.74, 0.58)), (7.8, 5.4, (0.6, 0.44, 0.5)),
    ]  # fmt: skip
    boards, glass = materials.planks(rng, 16), materials.metal(rng, (0.5, 0.56, 0.62), 0.08, 0.04)
    frames, panes, shutters = [], [], []
    for x, height, hue in fronts:
        stage.put(shapes.box(3.8, height, 3.0, 0.35), materials.plaster(rng, hue), placed(x, 0, -9.5))
        for y in np.arange(0.9, height - 1.1, 1.9):
            for dx in (-1.0, 0.25, 1.5):
                at = placed(x + dx - 0.25, y, -8.0)
                panes.append((shapes.box(0.6, 1.1, 0.04), at))
                frames.append((shapes.box(0.03, 1.1, 0.08), at))
                frames.append((shapes.box(0.6, 0.03, 0.08), at @ placed(0, 0.55, 0)))
                for side in (-0.46, 0.46):
                    shutters.append((shapes.box(0.3, 1.15, 0.08, 1.6), at @ placed(side, 0, 0)))
    stage.put(panes, glass)
    stage.put(frames, materials.paint(rng, (0.9, 0.9, 0.88)))
    stage.put(shutters, boards)
    stage.put(shapes.box(3.0, 5.8, 9.0, 0.35), materials.brick(rng, 14), placed(-7.6, 0, -3.6))
    awning = placed(3.2, 2.3, -7.2) @ turned_by(0, 0.35)
    stage.put(shapes.plane(3.0, 1.6, 0.5), materials.striped(rng, 7, (0.72, 0.12, 0.1)), awning)
    legs = [(shapes.cylinder(0.025, 2.05, 8), placed(x, 0, -6.5)) for x in (1.8, 4.6)]
    stage.put(legs, materials.metal(rng, (0.7, 0.7, 0.72), 0.3))


def _fence(rng: Rng, stage: Stage) -> None:
    """Add chain-link that runs away from the camera on the left, with posts and a rail."""
    stage.put(shapes.wall(9.0, 1.9, 0.75), materials.fence(rng, 10), placed(-3.3, 0, -3.2, yaw=np.pi / 2.0))
    posts = [(shapes.cylinder(0.035, 2.0, 10), placed(-3.3, 0, z)) for z in np.arange(-7.7, 1.4, 1.5)]
    rail = shapes.tube([(-3.3, 1.92, -7.7), (-3.3, 1.92, 1.3)], 0.025)
    stage.put([*posts, rail], materials.metal(rng, (0.72, 0.73, 0.75), 0.35))


def _fountain(rng: Rng, stage: Stage) -> None:
    """Add a basin with a turning golden knot over water, and a chrome ball beside it."""
    stone = materials.concrete(rng)
    rim = [(1.25, 0.0), (1.3, 0.42), (1.12, 0.45), (1.08, 0.3), (0.0, 0.3)]
    stage.put(shapes.lathe(rim, 48), stone, placed(0.3, 0, -3.6))
    water = materials.metal(rng, (0.25, 0.33, 0.38), 0.05, 0.05)
    stage.put(shapes.lathe([(1.1, 0.34), (0.0, 0.341)], 40), water, placed(0.3, 0, -3.6))
    stage.put(shapes.box(0.42, 1.05, 0.42, 0.8), stone, placed(0.3, 0, -3.6))
    gold = materials.metal(rng, (1.0, 0.74, 0.34), 0.12)
    knot = shapes.tube(shapes.knot(121, 0.36, 0.15, 0.3), 0.085, 14)
    stage.put(knot, gold, paths.spinning(placed(0.3, 1.58, -3.6), (0, 1, 0), 1.6))
    chrome = materials.metal(rng, (0.93, 0.93, 0.94), 0.05, 0.03)
    stage.put(shapes.ball(0.34, 24), chrome, placed(-1.75, 0.34, -2.5))


def _garden(rng: Rng, stage: Stage) -> None:
    wood, soil = materials.planks(rng, 6), materials.ground(rng, (0.2, 0.14, 0.1), 0.6)
    for x, z in ((3.5, -2.4), (-2.1, -6.4)):
        stage.put(shapes.box(1.5, 0.45, 1.5, 0.9), wood, placed(x, 0, z))
        stage.put(shapes.box(1.36, 0.02, 1.36), soil, placed(x, 0.45, z))
        tree(rng, stage, (x, z), (0.32, 0.44, 0.14), 0.1)
    for x, z in ((4.3, -1.3), (3.9, -3.6), (-2.9, -5.2)):
        bush(rng, stage, (x, z), 0.08)


def _cart(rng: Rng, stage: Stage) -> None:
    """Add a vendor's cart that rolls through the image and disoccludes the background."""
    rolling = paths.upright(lambda t: np.array([-2.5 + 3.4 * t, 0.0, -1.3]))
    box, lid = shapes.box(1.0, 0.5, 0.6, 1.0), shapes.box(1.1, 0.05, 0.7)
    body = [(box, placed(0, 0.42, 0)), (lid, placed(0, 0.92, 0))]
    stage.put(body, materials.paint(rng, (0.1, 0.4, 0.45), 0.8), rolling)
    poles = [(shapes.cylinder(0.016, 0.85, 8), placed(x, 0.95, z)) for x in (-0.5, 0.5) for z in (-0.3, 0.3)]
    stage.put(poles, materials.metal(rng, (0.85, 0.7, 0.4), 0.2), rolling)
    for tilt in (-1.0, 1.0):
        slope = placed(0, 1.92, 0.21 * tilt) @ turned_by(0, 0.5 * tilt)
        cloth = materials.striped(rng, 5, (0.9, 0.55, 0.1))
        stage.put(shapes.plane(1.25, 0.52, 0.8), cloth, paths.attached(rolling, slope))
    rim = (shapes.torus(0.3, 0.03, 32), turned_by(0, np.pi / 2.0))
    ends = [(0.3 * np.sin(a), 0.3 * np.cos(a), 0) for a in np.linspace(0, 2 * np.pi, 10, endpoint=False)]
    spokes = [shapes.tube([(0, 0, 0), end], 0.012, 5) for end in ends]
    wheel, iron = shapes.merged([rim, *spokes]), materials.paint(rng, (0.5, 0.08, 0.06))
    for z in (-0.36, 0.36):
        turning = paths.spinning(placed(0.05, 0.33, z), (0, 0, 1), -3.4 / 0.33)
        stage.put(wheel, iron, paths.attached(rolling, turning))


def _balls(rng: Rng, stage: Stage) -> None:
    for x, z, speed in ((1.6, -1.9, 3.0), (-0.9, -0.4, 2.2), (2.2, -5.2, 5.0)):
        across = paths.swing(rng, (x - 1.6, 0.0, z), (x + 1.6, 0.0, z - 0.5), speed)
        path = paths.bounces(rng, across, rng.uniform(0.5, 1.1), 0.14)
        cover, pose = materials.striped(rng, 4), paths.spinning(path, rng.normal(size=3), 9.0)
        stage.put(shapes.ball(0.14, 12), cover, pose)


def _lights(rng: Rng, stage: Stage) -> None:
    """Add lanterns on the cords that throb, a blinking sign, and a spot that sweeps over the house fronts."""
    for x, y, z in ((-4.4, 2.9, -4.4), (-2.2, 3.1, -4.3), (2.4, 3.0, -4.6), (4.2, 2.6, -1.8)):
        glow, color = lighting.pulse(rng, "throb"), lighting.tint(rng, 5.0, 0.7)
        bulb(stage, (x, y, z), color, size=0.11, reach=5.0, pulsing=glow)
    blinking = lighting.pulse(rng, "strobe")
    sign, shine = shapes.box(1.1, 0.4, 0.1), materials.glow((1.0, 0.25, 0.45), 4.0)
    stage.put(sign, shine, placed(-1.2, 2.75, -7.9), emission=blinking)
    stage.points.append(lighting.lamp((-1.2, 2.6, -7.2), (14.0, 3.5, 6.5), reach=6.0, pulsing=blinking))
    sweep = paths.swing(rng, (-4.5, 1.5, -8.0), (4.5, 2.5, -8.0), 7.0)
    stage.spot = lighting.spotlight((-1.0, 5.5, 1.5), sweep, (200.0, 420.0, 700.0), outer=13.0, reach=18.0)


NAME = "plaza"
DISPLAY_SIZE = (640, 360)
FRAMES = 16
_FORM = ShotForm(
    name=NAME, ratios=(2.0,), variants=False, gbuffers=False, small=True, first_reference=11,
    license="Apache-2.0", compression="zip:9", reference_compression="dwab:90",
)  # fmt: skip


class Plaza(Sequence):
    """The plaza over time, without cuts, at constant exposure."""

    def __init__(self) -> None:
        self.spec = SequenceSpec(family=NAME, seed=1, frames=FRAMES, frame_rate=30.0)
        content, hand = (np.random.default_rng([self.spec.seed, i]) for i in (0, 1))
        self.stage, self._shake = plaza(content), drift(hand, 0.015, 1.3)

    def camera(self, index: int) -> Camera:
        """Return a camera that walks ahead and to the right, and looks at the fountain."""
        t = self.time(index)
        eye = np.array([-1.5 + 2.1 * t, 1.62, 3.0 - 0.6 * t]) + self._shake(t)
        return Camera(
            position=vector(eye), target=(0.1 + 0.4 * t, 1.45, -3.6), fov_y=55.0, exposure=self.stage.exposure
        )


def render_product_shot(folder: Path, *, on_frame: Callable[[], None] = lambda: None) -> None:
    """Render the shipped shot into `folder`, or resume.

    Raises:
        ShotError: writing failed, or the folder holds another shot.
        GraphicsError: there is no OpenGL.
    """
    render_shot(folder, Plaza(), Renderer(DISPLAY_SIZE, samples=64), _FORM, on_frame=on_frame)
