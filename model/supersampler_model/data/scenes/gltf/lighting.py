"""The lights of a composition: a sky or a panorama, a sun, a moving spot, flickering points."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from OpenImageIO import ImageInput, geterror

from supersampler.io.files import image_size_problem, utf8_path
from supersampler_model.data.scenes.environment import Environment, directions
from supersampler_model.data.scenes.gltf.errors import MalformedError, reading
from supersampler_model.data.scenes.gltf.motions import Course, wave
from supersampler_model.data.scenes.lights import Sun
from supersampler_model.data.scenes.procedural import lighting
from supersampler_model.data.scenes.procedural.lighting import Pulse
from supersampler_model.data.scenes.procedural.paths import Place, vector
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.values import Color, Rng, Values

_SKY = 64  # rows of a procedural sky
_DIMMEST = 0.12  # least factor of a sky or a panorama
_BRIGHTEST = 50.0  # panoramas are clamped to this: their suns would sparkle in every reflection


Lamp = tuple[Place, Color, Pulse]
"""Path, colour and flicker of a light."""


def lit_stage(rng: Rng, focus: Values, panorama: Environment | None) -> Stage:
    """Return an empty stage with random lights around `focus` (3,), and the exposure that suits them.

    Without a panorama of the surroundings it has a random sky.
    """
    surroundings = sky(rng) if panorama is None else panorama
    dim = float(np.exp(rng.uniform(np.log(_DIMMEST), 0.0)))  # in the dark the lamps matter more
    environment = Environment(pixels=(surroundings.pixels * dim).astype(np.float32))
    stage = Stage(environment=environment, exposure=float(dim**-0.6))
    stage.sun = _sun(rng, focus)
    if rng.random() < 0.7:
        place, color, flicker = _lamp(rng, focus, 2.5, 14.0, 0.7)
        stage.spot = lighting.spotlight(place, focus, color, inner=20.0, outer=32.0, pulsing=flicker)
    for _ in range(int(rng.integers(4))):
        place, color, flicker = _lamp(rng, focus, 0.8, 1.5, 0.9)
        stage.points.append(lighting.lamp(place, color, reach=6.0, pulsing=flicker))
    return stage


def _sun(rng: Rng, focus: Values) -> Callable[[float], Sun] | None:
    """Return a sun, mostly steady; None: there is none."""
    height, around = rng.uniform(0.3, 1.3), rng.uniform(0.0, 2.0 * np.pi)
    toward = np.array([np.cos(height) * np.cos(around), np.sin(height), np.cos(height) * np.sin(around)])
    strength = rng.uniform(0.5, 4.0) if rng.random() < 0.7 else 0.0
    color, direction, center = strength * _tint(rng), vector(-toward), vector(focus)
    flicker = wave(rng.uniform(0.0, 0.8) * (rng.random() < 0.3), rng.uniform(0.2, 3.0))
    if strength == 0.0:
        return None
    return lambda t: Sun(direction=direction, color=vector(color * flicker(t)), center=center, radius=12.0)


def _lamp(rng: Rng, focus: Values, height: float, strength: float, flickering: float) -> Lamp:
    """Return a light that moves at about `height` metres above the focus; `flickering` is at most 1."""
    low, high = (-2.0, 0.8 * height, -2.0), (2.0, 1.2 * height, 2.0)
    course = Course(focus + rng.uniform(low, high), focus + rng.uniform(low, high), rng.uniform(0.3, 4.0))
    flicker = wave(
        rng.uniform(0.0, flickering), rng.uniform(0.5, 8.0), rng.random(), square=rng.random() < 0.3
    )
    return course.at, vector(rng.uniform(0.5, 1.5) * strength * _tint(rng)), flicker


def sky(rng: Rng) -> Environment:
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
        source = ImageInput.open(utf8_path(path))
        if source is None:
            raise MalformedError(f"the panorama is damaged ({geterror().strip()})")
        spec = source.spec()
        if (problem := image_size_problem(spec.width, spec.height)) is not None:
            raise MalformedError(f"the panorama {problem}")
        pixels = source.read_image(0, 0, 0, 3, "float")
        if pixels is None:
            raise MalformedError(f"the panorama is damaged ({source.geterror().strip()})")
        return Environment(pixels=np.ascontiguousarray(np.clip(pixels, 0.0, _BRIGHTEST), np.float32))


def _tint(rng: Rng) -> Values:
    """Return a colour of mean 1 between candle light and a clear sky."""
    warmth = rng.uniform(-1.0, 1.0)
    color = np.array([1.0 + 0.5 * warmth, 1.0, 1.0 - 0.5 * warmth])
    return np.asarray(color / color.mean())
