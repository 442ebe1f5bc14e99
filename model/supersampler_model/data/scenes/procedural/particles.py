"""Particles as functions of time in seconds. As in engines, they have no motion vectors."""

from collections.abc import Callable, Sequence

import numpy as np

from supersampler_model.data.scenes.scene import Color, Particles, Rng, Values

Cloud = Callable[[float], Particles]
"""Seconds to particles."""


def sparks(rng: Rng, origin: Sequence[float], count: int = 60) -> Cloud:
    """Return sparks that fly from a point, fall and fade, repeatedly."""
    speed = rng.normal((0.0, 2.2, 0.0), 1.3, (count, 3))
    start, life = rng.random(count), rng.uniform(0.5, 1.1, count)

    def at(t: float) -> Particles:
        age = (t / life + start) % 1.0 * life
        centers = np.asarray(origin) + speed * age[:, None] - (0.0, 4.9, 0.0) * age[:, None] ** 2
        fading = 6.0 * (1.0 - age / life)
        return _sprites(centers, 0.018, fading[:, None] * (1.0, 0.55, 0.15), 0.0)

    return at


def dust(
    rng: Rng, low: Sequence[float], high: Sequence[float], count: int = 80, *, size: float = 0.012,
    color: Color = (0.9, 0.85, 0.7), opacity: float = 0.5,
) -> Cloud:  # fmt: skip
    """Return motes that drift in a box and wrap around; opacity 0 makes them glow."""
    corner, extent = np.asarray(low, np.float64), np.subtract(high, low)
    start, drift = rng.random((count, 3)), rng.normal((0.25, 0.05, 0.0), 0.35, (count, 3))
    radii = size * rng.uniform(0.5, 1.6, count)

    def at(t: float) -> Particles:
        centers = corner + extent * ((start + drift * t / extent) % 1.0)
        return _sprites(centers, radii, np.array(color) * (opacity or 1.0), opacity)

    return at


def smoke(
    rng: Rng, origin: Sequence[float], count: int = 24, *, grey: float = 0.35, rise: float = 1.2
) -> Cloud:
    """Return puffs that rise from a point, grow and thin out."""
    start, lean = rng.random(count), rng.normal((0.1, rise, 0.0), 0.18, (count, 3))
    life = 1.8

    def at(t: float) -> Particles:
        age = (t / life + start) % 1.0
        way = (age * life)[:, None] * lean
        opacity = 0.35 * np.sin(np.pi * age)
        return _sprites(np.asarray(origin) + way, 0.08 + 0.35 * age, grey * opacity[:, None], opacity)

    return at


def fireflies(rng: Rng, low: Sequence[float], high: Sequence[float], count: int = 25) -> Cloud:
    """Return lights that wander and blink."""
    home = rng.uniform(low, high, (count, 3))
    rates, phases = rng.uniform(1.0, 4.0, (count, 3)), rng.uniform(0.0, 6.3, (count, 3))

    def at(t: float) -> Particles:
        centers = home + 0.35 * np.sin(rates * t + phases)
        light = 2.5 * np.clip(np.sin(3.0 * rates[:, 0] * t + phases[:, 1]), 0.0, 1.0)
        return _sprites(centers, 0.025, light[:, None] * (0.8, 1.0, 0.3), 0.0)

    return at


def _sprites(centers: Values, radii: float | Values, light: Values, opacity: float | Values) -> Particles:
    """Return particles at centers (n, 3); the other arguments are broadcast to n particles."""
    colors = np.empty((len(centers), 4), np.float32)
    colors[:, :3], colors[:, 3] = light, opacity
    sizes = np.full(len(centers), radii, np.float32)
    return Particles(centers=centers.astype(np.float32), radii=sizes, colors=colors)
