"""The stage of a family: all objects and lights of a scene as functions of time in seconds."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from supersampler_model.data.scenes.procedural.lighting import Pulse, steady
from supersampler_model.data.scenes.procedural.paths import Pose, Vantage
from supersampler_model.data.scenes.procedural.shapes import Part, merged
from supersampler_model.data.scenes.scene import (
    Camera,
    Environment,
    Instance,
    Material,
    Matrices,
    Matrix,
    Mesh,
    Particles,
    Point,
    Scene,
    Spot,
    Sun,
    Vector,
)


class Prop(NamedTuple):
    """An object that may move, bend and flicker."""

    mesh: Mesh
    material: Material
    pose: Pose
    palette: Callable[[float], Matrices] | None
    emission: Pulse
    casts_shadow: bool

    def instance(self, now: float, before: float) -> Instance:
        """Return the object at the time `now`, with its state at the time `before`, both in seconds."""
        return Instance(
            mesh=self.mesh,
            material=self.material,
            model=self.pose(now),
            model_before=self.pose(before),
            palette=None if self.palette is None else self.palette(now),
            palette_before=None if self.palette is None else self.palette(before),
            emission=self.emission(now),
            casts_shadow=self.casts_shadow,
        )


@dataclass(slots=True, kw_only=True, eq=False)
class Stage:
    """Objects, lights and camera positions of a scene.

    Attributes:
        environment: the panorama around it.
        exposure: that suits its light.
        vantages: camera positions; each shot takes one.
    """

    environment: Environment
    exposure: float = 1.0
    vantages: list[Vantage] = field(default_factory=list)
    props: list[Prop] = field(default_factory=list)
    sun: Callable[[float], Sun] | None = None
    spot: Callable[[float], Spot] | None = None
    points: list[Callable[[float], Point]] = field(default_factory=list)
    particles: list[Callable[[float], Particles]] = field(default_factory=list)

    def put(
        self, mesh: Mesh | Iterable[Part], material: Material, at: Matrix | Pose | None = None, *,
        palette: Callable[[float], Matrices] | None = None, emission: Pulse = steady, shadow: bool = True,
    ) -> None:  # fmt: skip
        """Add an object, at the origin by default; several parts are merged into one mesh."""
        fixed = np.eye(4) if at is None else at
        pose = fixed if callable(fixed) else lambda _: fixed
        mesh = mesh if isinstance(mesh, Mesh) else merged(mesh)
        self.props.append(Prop(mesh, material, pose, palette, emission, shadow))

    def add_vantages(self, *views: tuple[Vector, Vector, float], brisk: bool = False) -> None:
        """Add camera positions: position, target and room, see `Vantage`."""
        self.vantages += [Vantage(*view, brisk) for view in views]

    def scene(self, now: float, before: float, camera: Camera, camera_before: Camera) -> Scene:
        """Return the stage at the time `now`, with its state at the time `before`, both in seconds."""
        return Scene(
            camera=camera,
            camera_before=camera_before,
            environment=self.environment,
            instances=tuple(prop.instance(now, before) for prop in self.props),
            sun=None if self.sun is None else self.sun(now),
            spot=None if self.spot is None else self.spot(now),
            points=tuple(point(now) for point in self.points),
            particles=tuple(cloud(now) for cloud in self.particles),
        )
