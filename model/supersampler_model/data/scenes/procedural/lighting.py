"""Random lights as functions of time in seconds, and random panoramas."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from supersampler_model.data.scenes import scene as scenes
from supersampler_model.data.scenes.procedural.paths import Place, Point3, pendulum, place_of, vector

Pulse = Callable[[float], float]
"""Seconds to a factor >= 0, about 1 on average."""
PULSES = ("throb", "flicker", "strobe", "fade")
_COMMON = (0.4, 0.25, 0.15, 0.2)  # probability of each
HEIGHT = 128  # of panoramas


def steady(_: float) -> float:
    """Return 1."""
    return 1.0


def pulse(rng: scenes.Rng, *kinds: str) -> Pulse:
    """Return a pulse of one of these kinds; by default, of any of the PULSES."""
    kind = kinds[0] if len(kinds) == 1 else str(rng.choice(kinds or PULSES, p=None if kinds else _COMMON))
    phase, depth = rng.uniform(0.0, 6.3), rng.uniform(0.5, 0.95)
    rate = 2.0 * np.pi * rng.uniform(*{"throb": (0.6, 2.5), "strobe": (1.5, 4.0)}.get(kind, (0.25, 0.6)))
    if kind == "flicker":
        levels, steps = rng.choice([0.1, 0.5, 1.0, 1.6], 97, p=(0.2, 0.15, 0.45, 0.2)), rng.uniform(8.0, 15.0)
        return lambda t: float(levels[int(np.floor(t * steps)) % len(levels)])
    if kind == "strobe":
        return lambda t: 1.8 if np.sin(rate * t + phase) > 0.0 else 0.15
    sharp = 3.0 if kind == "fade" else 1.0
    return lambda t: float(1.0 + depth * np.tanh(sharp * np.sin(rate * t + phase)))


def nervous(rng: scenes.Rng) -> Pulse:
    """Return a pulse that changes fast: it throbs, flickers or blinks."""
    return pulse(rng, str(rng.choice(("throb", "flicker", "strobe"), p=(0.5, 0.35, 0.15))))


def maybe(rng: scenes.Rng, chance: float, make: Callable[..., Pulse], *kinds: str) -> Pulse:
    """Return `make(rng, *kinds)` with this probability, otherwise a steady light."""
    return make(rng, *kinds) if rng.random() < chance else steady


def clouds(rng: scenes.Rng) -> Pulse:
    """Return the factor of a sun behind broken clouds: one or two edges a second, soft or abrupt."""
    rates, phases = 2.0 * np.pi * rng.uniform((0.4, 0.9), (0.7, 1.4)), rng.uniform(0.0, 6.3, 2)
    sharp, depth = float(np.exp(rng.uniform(0.8, 3.3))), rng.uniform(0.5, 0.9)
    return lambda t: float(1.15 - depth * (0.5 + 0.5 * np.tanh(sharp * np.sin(rates * t + phases).sum())))


def lightning(rng: scenes.Rng) -> Pulse:
    """Return the factor of moonlight in a thunderstorm: bursts of a few frames, many times as bright."""
    gap, first, strength = rng.uniform(0.4, 0.9), rng.random(), rng.uniform(12.0, 30.0)
    bursts = rng.choice((0.0, 0.25, 0.6, 1.0), (7, 6), p=(0.3, 0.25, 0.25, 0.2))

    def at(t: float) -> float:
        count, age = divmod(t / gap + first, 1.0)
        step = int(age * gap * 15.0)  # a level lasts two frames of 30 a second
        burst = bursts[int(count) % len(bursts)]
        return 1.0 + strength * float(burst[step]) if step < len(burst) else 1.0

    return at


def tint(rng: scenes.Rng, strength: float, warmth: float | None = None) -> scenes.Color:
    """Return a light's colour, `strength` at its brightest channel.

    `warmth` is -1 for blue sky, 0 for white, 1 for a candle; None is any hue.
    """
    if warmth is None:
        hue = rng.uniform(0.0, 2.0 * np.pi)
        rgb = 0.55 + 0.45 * np.cos(hue + np.array([0.0, 2.1, 4.2]))
    else:
        cold, warm = max(-warmth, 0.0), max(warmth, 0.0)
        rgb = np.array([1.0 - 0.6 * cold, 1.0 - 0.25 * cold - 0.4 * warm, 1.0 - 0.8 * warm])
    return vector(strength * rgb / rgb.max())


def sunlight(
    rng: scenes.Rng, strength: float, radius: float, *, elevation: tuple[float, float] = (25.0, 60.0),
    pulsing: Pulse = steady, warmth: float | None = 0.3, center: scenes.Vector = (0.0, 0.0, 0.0),
    azimuth: tuple[float, float] = (0.0, 6.3),
) -> Callable[[float], scenes.Sun]:  # fmt: skip
    """Return a sun of irradiance `strength` whose shadows move slowly.

    Its shadow map covers `radius` metres around `center`. `elevation` is a range in degrees. `azimuth` is a
    range of the direction of its light, radians: 0 is +x, pi / 2 is +z. See `tint` for `warmth`.
    """
    color, turn = tint(rng, strength, warmth), rng.uniform(*azimuth)
    height, creep = np.radians(rng.uniform(*elevation)), rng.normal(0.0, 0.08)

    def at(t: float) -> scenes.Sun:
        angle = turn + creep * t
        level = np.cos(height)
        direction = vector((level * np.cos(angle), -np.sin(height), level * np.sin(angle)))
        light = vector(np.multiply(color, pulsing(t)))
        return scenes.Sun(direction=direction, color=light, center=center, radius=radius)

    return at


def spotlight(
    place: Place | Point3, target: Place | Point3, color: scenes.Color, *, inner: float | None = None,
    outer: float = 32.0, reach: float = 20.0, pulsing: Pulse = steady,
) -> Callable[[float], scenes.Spot]:  # fmt: skip
    """Return a spot light that looks from one place, fixed or moving, to another."""
    eye, aim, inner = place_of(place), place_of(target), 0.55 * outer if inner is None else inner
    return lambda t: scenes.Spot(
        position=vector(eye(t)), target=vector(aim(t)), color=vector(np.multiply(color, pulsing(t))),
        inner=inner, outer=outer, reach=reach,
    )  # fmt: skip


def hanging(
    rng: scenes.Rng,
    pivot: Sequence[float],
    length: float,
    extent: float,
    color: scenes.Color,
    *,
    pulsing: Pulse = steady,
) -> tuple[Place, Callable[[float], scenes.Spot]]:
    """Return the path of a lamp that swings on a cable, see `pendulum`, and its cone of light."""
    place, top = pendulum(rng, pivot, length, extent), np.asarray(pivot, np.float64)
    return place, spotlight(place, lambda t: 3.0 * place(t) - 2.0 * top, color, outer=57.0, pulsing=pulsing)


def lamp(
    place: Place | Point3, color: scenes.Color, *, reach: float = 8.0, pulsing: Pulse = steady
) -> Callable[[float], scenes.PointLight]:
    """Return a point light at a place, fixed or moving."""
    position = place_of(place)
    return lambda t: scenes.PointLight(
        position=vector(position(t)), color=vector(np.multiply(color, pulsing(t))), reach=reach
    )


def outdoors(
    rng: scenes.Rng, zenith: scenes.Color, horizon: scenes.Color, ground: scenes.Color, *, clouds: float = 0.5
) -> scenes.Environment:
    """Return a sky over a ground, from radiances; `clouds` is the brightness of the clouds."""
    around = scenes.directions(HEIGHT)
    up = around[..., 1:2]
    sky = np.array(horizon) + (np.array(zenith) - horizon) * np.clip(up, 0.0, 1.0) ** 0.5
    waves = rng.normal(0.0, 1.0, (24, 3)) * np.exp(rng.uniform(0.5, 2.8, (24, 1)))
    stretched = around / np.maximum(np.abs(up) + 0.25, 0.25)  # clouds lie in a plane: flatter far away
    layers = np.sin(stretched @ waves.T + rng.uniform(0.0, 6.3, 24)) / np.linalg.norm(waves, axis=1)
    mist = layers.sum(axis=-1)
    cover = np.clip(mist / mist.std() * 0.8 - 0.1, 0.0, 1.0)[..., None] * np.clip(up * 6.0, 0.0, 1.0)
    sky = sky * (1.0 - 0.6 * cover) + cover * clouds * (np.array(horizon) + 0.5 * np.mean(horizon))
    earth = np.array(ground) * (1.0 + 0.4 * np.sin(5.0 * around[..., :1] + 3.0 * around[..., 2:]))
    blend = np.clip(up * 40.0 + 0.5, 0.0, 1.0)
    return scenes.Environment(pixels=(blend * sky + (1.0 - blend) * earth).astype(np.float32))


def indoors(rng: scenes.Rng, ambient: scenes.Color, panels: int, strength: float) -> scenes.Environment:
    """Return a dim room with bright rectangles on its ceiling and upper walls, for metals to reflect."""
    around = scenes.directions(HEIGHT)
    up = around[..., 1]
    azimuth = np.arctan2(around[..., 0], -around[..., 2])
    image = np.array(ambient) * (0.6 + 0.4 * up)[..., None]
    for _ in range(panels):
        middle, height = rng.uniform(-np.pi, np.pi), rng.uniform(0.15, 0.85)
        wide, tall = rng.uniform(0.08, 0.5), rng.uniform(0.04, 0.18)
        distance = np.abs((azimuth - middle + np.pi) % (2.0 * np.pi) - np.pi)
        inside = (distance < wide) & (np.abs(up - height) < tall)
        image = image + inside[..., None] * np.array(tint(rng, strength, rng.uniform(-0.5, 0.5)))
    return scenes.Environment(pixels=image.astype(np.float32))


class Weather(NamedTuple):
    """Light outdoors, with an exposure that suits it."""

    environment: scenes.Environment
    exposure: float
    sun: Callable[[float], scenes.Sun]  # the sun or the moon, from behind a camera that looks along -z
    dark: bool  # whether the scene needs lamps


class Hour(NamedTuple):
    """Radiances of the sky and the ground, and the sun or moon."""

    zenith: scenes.Color
    horizon: scenes.Color
    ground: scenes.Color
    strength: float
    warmth: float
    elevation: tuple[float, float]
    exposure: float


HOURS = {
    "day": Hour((0.11, 0.23, 0.52), (0.42, 0.47, 0.54), (0.1, 0.1, 0.08), 6.5, 0.25, (28.0, 58.0), 0.75),
    "stark": Hour((0.04, 0.11, 0.32), (0.2, 0.24, 0.3), (0.05, 0.045, 0.04), 9.0, 0.2, (22.0, 50.0), 0.6),
    "dusk": Hour((0.035, 0.05, 0.14), (0.34, 0.16, 0.08), (0.03, 0.025, 0.02), 5.0, 0.65, (16.0, 30.0), 0.95),
    "night": Hour((0.002, 0.003, 0.01), (0.011, 0.011, 0.018), (0.003,) * 3, 0.22, -0.6, (30.0, 55.0), 2.4),
}


def weather(rng: scenes.Rng, radius: float, center: scenes.Vector = (0.0, 0.0, 0.0)) -> Weather:
    """Return one of the HOURS: dull or bright days, hard sun, dusk or night.

    The shadow map of the sun covers `radius` metres around `center`.
    """
    name = str(rng.choice(tuple(HOURS), p=(0.42, 0.28, 0.12, 0.18)))
    hour, dark = HOURS[name], name == "night"
    pulsing = maybe(rng, 0.3, lightning) if dark else maybe(rng, 0.85, clouds)
    sky = outdoors(rng, hour.zenith, hour.horizon, hour.ground, clouds=rng.uniform(0.5, 1.1))
    exposure = hour.exposure * rng.uniform(0.9, 1.15)
    sun = sunlight(
        rng, hour.strength, radius, elevation=hour.elevation, pulsing=pulsing, warmth=hour.warmth,
        center=center, azimuth=(3.9, 5.5),
    )  # fmt: skip
    return Weather(sky, exposure, sun, dark)
