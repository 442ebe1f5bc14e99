"""The lights of a composition: a sky or a panorama, a sun, a moving spot, flickering points."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from OpenImageIO import ImageInput, geterror

from supersampler.io.limits import image_size_problem
from supersampler_model.data.scenes.environment import Environment, directions
from supersampler_model.data.scenes.gltf.accessors import Values
from supersampler_model.data.scenes.gltf.errors import MalformedError, reading
from supersampler_model.data.scenes.gltf.motions import Course, Flicker
from supersampler_model.data.scenes.lights import Point, Spot, Sun
from supersampler_model.data.values import Color, Vector

_SKY = 64  # rows of a procedural sky
_DIMMEST = 0.12  # of what a sky or a panorama is multiplied by
_BRIGHTEST = 50.0  # of a panorama; a sun of its own would sparkle in every reflection


class Lights(NamedTuple):
    """The lights of a moment."""

    sun: Sun | None
    spot: Spot | None
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Lamp:
    """A light that moves and flickers."""

    course: Course
    color: Values
    flicker: Flicker

    def at(self, time: float) -> tuple[Vector, Color]:
        """Return its place and colour."""
        return _triple(self.course.at(time)), _triple(self.color * self.flicker.at(time))


class Lighting:
    """All lights of a composition, random, around the camera's target.

    Attributes:
        environment: shared by all frames.
        exposure: that suits it.
    """

    def __init__(self, rng: np.random.Generator, focus: Values, environment: Environment | None) -> None:
        """Draw the lights around a place (3,); None draws a sky too."""
        self._focus = focus
        around_it = sky(rng) if environment is None else environment
        dim = float(np.exp(rng.uniform(np.log(_DIMMEST), 0.0)))  # the darker it is, the more the lamps matter
        self.environment = Environment(pixels=(around_it.pixels * dim).astype(np.float32))
        self.exposure = float(dim**-0.6)
        height, around = rng.uniform(0.3, 1.3), rng.uniform(0.0, 2.0 * np.pi)
        toward = np.array([np.cos(height) * np.cos(around), np.sin(height), np.cos(height) * np.sin(around)])
        strength = rng.uniform(0.5, 4.0) if rng.random() < 0.7 else 0.0
        color = _triple(strength * _tint(rng))
        self._sun = Sun(direction=_triple(-toward), color=color, center=_triple(focus), radius=12.0)
        self._sun_flicker = Flicker(rng.uniform(0.0, 0.8) * (rng.random() < 0.3), rng.uniform(0.2, 3.0))
        self._spot = self._lamp(rng, 2.5, 14.0, 0.7) if rng.random() < 0.7 else None
        self._points = [self._lamp(rng, 0.8, 1.5, 0.9) for _ in range(int(rng.integers(4)))]

    def at(self, time: float) -> Lights:
        """Return the lights of a moment."""
        color = _triple(np.array(self._sun.color) * self._sun_flicker.at(time))
        sun = replace(self._sun, color=color) if max(color) > 0.0 else None
        spot = None
        if self._spot is not None:
            position, color = self._spot.at(time)
            spot = Spot(position=position, target=_triple(self._focus), color=color, inner=20.0, outer=32.0)
        points = tuple(
            Point(position=p, color=c, reach=6.0) for p, c in (lamp.at(time) for lamp in self._points)
        )
        return Lights(sun, spot, points)

    def _lamp(self, rng: np.random.Generator, height: float, strength: float, depth: float) -> Lamp:
        low, high = (-2.0, 0.8 * height, -2.0), (2.0, 1.2 * height, 2.0)
        course = Course(
            self._focus + rng.uniform(low, high), self._focus + rng.uniform(low, high), rng.uniform(0.3, 4.0)
        )
        flicker = Flicker(rng.uniform(0.0, depth), rng.uniform(0.5, 8.0), rng.random(), rng.random() < 0.3)
        return Lamp(course, rng.uniform(0.5, 1.5) * strength * _tint(rng), flicker)


def sky(rng: np.random.Generator) -> Environment:
    """Return a sky above a ground, with a bright side."""
    up = directions(_SKY)
    above, below, side = (rng.uniform(0.3, 1.0) * _tint(rng) for _ in range(3))
    bright = rng.normal(size=3) + np.array([0.0, 1.0, 0.0])
    lobe = np.clip(up @ (bright / np.linalg.norm(bright)), 0.0, 1.0) ** rng.uniform(2.0, 40.0)
    blend = 0.5 + 0.5 * np.tanh(6.0 * up[..., 1:2])
    color = blend * above + (1.0 - blend) * 0.4 * below + rng.uniform(0.5, 4.0) * lobe[..., None] * side
    return Environment(pixels=color.astype(np.float32))


def panorama(path: Path) -> Environment:
    """Read a panorama (.hdr) whose size is (2 h, h), h a power of two.

    Raises:
        GltfError: it is damaged, too large, or of another size.
    """
    with reading(path):
        with path.open("rb") as file:
            if file.read(2) != b"#?":
                raise MalformedError("the panorama is no .hdr file")
        source = ImageInput.open(str(path))
        if source is None:
            raise MalformedError(f"the panorama is damaged ({geterror().strip()})")
        spec = source.spec()
        if (problem := image_size_problem(spec.width, spec.height)) is not None:
            raise MalformedError(f"the panorama {problem}")
        pixels = source.read_image(0, 0, 0, 3, "float")
        if pixels is None:
            raise MalformedError(f"the panorama is damaged ({source.geterror().strip()})")
        return Environment(pixels=np.ascontiguousarray(np.clip(pixels, 0.0, _BRIGHTEST), np.float32))


def _tint(rng: np.random.Generator) -> Values:
    """Return a colour about white, from candle light to a clear sky, of brightness 1."""
    warmth = rng.uniform(-1.0, 1.0)
    color = np.array([1.0 + 0.5 * warmth, 1.0, 1.0 - 0.5 * warmth])
    return np.asarray(color / color.mean())


def _triple(values: Values) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
