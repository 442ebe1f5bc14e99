"""Lights that move and pulse, and panoramas; all of time in seconds and a generator."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.environment import Environment, directions
from supersampler_model.data.lights import Point, Spot, Sun
from supersampler_model.data.procedural.paths import Place, vector
from supersampler_model.data.values import Color, Vector

Values = NDArray[np.float64]
Rng = np.random.Generator
Pulse = Callable[[float], float]
"""Seconds to a factor >= 0, about 1 on average."""
PULSES = ("throb", "flicker", "strobe", "fade")
HEIGHT = 128  # of panoramas


def steady(_: float) -> float:
    """Return 1."""
    return 1.0


def pulse(rng: Rng, kind: str | None = None) -> Pulse:
    """Return one of the PULSES, drawn if none is named."""
    kind = kind or str(rng.choice(PULSES, p=(0.4, 0.25, 0.15, 0.2)))
    phase, depth = float(rng.uniform(0.0, 6.3)), float(rng.uniform(0.5, 0.95))
    rate = (
        2.0 * np.pi * float(rng.uniform(*{"throb": (0.6, 2.5), "strobe": (1.5, 4.0)}.get(kind, (0.25, 0.6))))
    )
    if kind == "flicker":
        levels, steps = rng.choice([0.1, 0.5, 1.0, 1.6], 97, p=(0.2, 0.15, 0.45, 0.2)), rng.uniform(8.0, 15.0)
        return lambda t: float(levels[int(np.floor(t * steps)) % len(levels)])
    if kind == "strobe":
        return lambda t: 1.8 if np.sin(rate * t + phase) > 0.0 else 0.15
    sharp = 3.0 if kind == "fade" else 1.0
    return lambda t: float(1.0 + depth * np.tanh(sharp * np.sin(rate * t + phase)))


def tint(rng: Rng, strength: float, warmth: float | None = None) -> Color:
    """Return a light's colour, `strength` at its brightest channel.

    Args:
        rng: of the colour.
        strength: of the brightest channel.
        warmth: from -1 (blue sky) over 0 (white) to 1 (candle); None is any hue.
    """
    if warmth is None:
        hue = rng.uniform(0.0, 2.0 * np.pi)
        rgb = 0.55 + 0.45 * np.cos(hue + np.array([0.0, 2.1, 4.2]))
    else:
        cold, warm = max(-warmth, 0.0), max(warmth, 0.0)
        rgb = np.array([1.0 - 0.6 * cold, 1.0 - 0.25 * cold - 0.4 * warm, 1.0 - 0.8 * warm])
    return vector(strength * rgb / rgb.max())


def sunlight(
    rng: Rng, strength: float, radius: float, *, elevation: tuple[float, float] = (25.0, 60.0),
    pulsing: Pulse = steady, warmth: float | None = 0.3, center: Vector = (0.0, 0.0, 0.0),
) -> Callable[[float], Sun]:  # fmt: skip
    """Return a sun whose shadows creep; `pulsing` is what clouds do to it, angles are in degrees."""
    color, azimuth = tint(rng, strength, warmth), float(rng.uniform(0.0, 6.3))
    height, creep = np.radians(float(rng.uniform(*elevation))), float(rng.normal(0.0, 0.08))

    def at(t: float) -> Sun:
        angle = azimuth + creep * t
        level = np.cos(height)
        direction = (level * np.cos(angle), -np.sin(height), level * np.sin(angle))
        return Sun(
            direction=vector(direction),
            color=vector(np.multiply(color, pulsing(t))),
            center=center,
            radius=radius,
        )

    return at


def spotlight(
    place: Place,
    target: Place,
    color: Color,
    *,
    outer: float = 32.0,
    reach: float = 20.0,
    pulsing: Pulse = steady,
) -> Callable[[float], Spot]:
    """Return a spot that moves along `place` and looks at `target`."""
    return lambda t: Spot(
        position=vector(place(t)),
        target=vector(target(t)),
        color=vector(np.multiply(color, pulsing(t))),
        inner=0.55 * outer,
        outer=outer,
        reach=reach,
    )


def lamp(
    place: Place, color: Color, *, reach: float = 8.0, pulsing: Pulse = steady
) -> Callable[[float], Point]:
    """Return a point light that moves along `place`."""
    return lambda t: Point(
        position=vector(place(t)), color=vector(np.multiply(color, pulsing(t))), reach=reach
    )


def at_rest(position: Sequence[float]) -> Place:
    """Return a place that does not change."""
    fixed = np.asarray(position, np.float64)
    return lambda _: fixed


def outdoors(rng: Rng, zenith: Color, horizon: Color, ground: Color, *, clouds: float = 0.5) -> Environment:
    """Return a sky over a ground: radiances, and the clouds' brightness on top."""
    around = directions(HEIGHT)
    up = around[..., 1:2]
    sky = np.array(horizon) + (np.array(zenith) - horizon) * np.clip(up, 0.0, 1.0) ** 0.5
    waves = rng.normal(0.0, 1.0, (24, 3)) * np.exp(rng.uniform(0.5, 2.8, (24, 1)))
    stretched = around / np.maximum(np.abs(up) + 0.25, 0.25)  # clouds lie in a plane: flatter far away
    mist = (np.sin(stretched @ waves.T + rng.uniform(0.0, 6.3, 24)) / np.linalg.norm(waves, axis=1)).sum(
        axis=-1
    )
    cover = np.clip(mist / mist.std() * 0.8 - 0.1, 0.0, 1.0)[..., None] * np.clip(up * 6.0, 0.0, 1.0)
    sky = sky * (1.0 - 0.6 * cover) + cover * clouds * (np.array(horizon) + 0.5 * np.mean(horizon))
    earth = np.array(ground) * (1.0 + 0.4 * np.sin(5.0 * around[..., :1] + 3.0 * around[..., 2:]))
    blend = np.clip(up * 40.0 + 0.5, 0.0, 1.0)
    return Environment(pixels=(blend * sky + (1.0 - blend) * earth).astype(np.float32))


def indoors(rng: Rng, ambient: Color, panels: int, strength: float) -> Environment:
    """Return a dim room with bright rectangles on its ceiling and upper walls: what metals mirror."""
    around = directions(HEIGHT)
    up = around[..., 1]
    azimuth = np.arctan2(around[..., 0], -around[..., 2])
    image = np.array(ambient) * (0.6 + 0.4 * up)[..., None]
    for _ in range(panels):
        middle, height = float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0.15, 0.85))
        wide, tall = float(rng.uniform(0.08, 0.5)), float(rng.uniform(0.04, 0.18))
        apart = np.abs((azimuth - middle + np.pi) % (2.0 * np.pi) - np.pi)
        inside = (apart < wide) & (np.abs(up - height) < tall)
        image = image + inside[..., None] * np.array(tint(rng, strength, float(rng.uniform(-0.5, 0.5))))
    return Environment(pixels=image.astype(np.float32))
