"""Frames with G-buffers whose colour is base colour times light, exact at any place and at any size."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler_model.data.scenes.analytic import EXTENT, FAR, NEAR, Values, Vector, grey, grids, places

Field = Callable[[Values, Values], Values]
"""(x, y), units, to (..., 3): base colour or light."""


def rough(x: Values, y: Values) -> Values:
    """A texture of a few units, never black."""
    waves = [np.sin((2.1 + c) * x + 0.7 * y) * np.cos(1.3 * y - c) for c in range(3)]
    return 0.5 + 0.4 * np.stack(waves, axis=-1)


def smooth(x: Values, y: Values) -> Values:
    """Light that changes slowly."""
    return grey(1.5 + 0.5 * np.sin(0.09 * x + 0.05 * y))


def even(x: Values, y: Values) -> Values:
    """Half of all."""
    return np.full((*np.broadcast(x, y).shape, 3), 0.5)


@dataclass(frozen=True)
class LitScene:
    """A plane that pans, and before it a disc; both keep their light, which moves with them.

    Velocities in units a frame; a unit is a pixel at 64 x 36. `disc_normal` and `disc_depth` tell the disc
    from the plane; `speed` multiplies both velocities in frame `index`, so that motion need not be even.
    """

    base: Field = rough
    light: Field = smooth
    velocity: Vector = (0.0, 0.0)
    disc_velocity: Vector = (0.0, 0.0)
    disc_base: Field = even
    disc_light: float = 6.0
    disc_normal: tuple[float, float, float] = (1.0, 0.0, 0.0)
    disc_depth: float = NEAR
    radius: float = 0.0
    start: Vector = (24.0, 18.0)
    sky: float = 0.0  # height of the strip on top where there is nothing

    def surface(self, index: int, x: Values, y: Values) -> dict[str, Values]:
        """Values seen at places of frame `index`, by the names of a frame's fields."""
        (vx, vy), (dx, dy) = self.velocity, self.disc_velocity
        there = x - index * vx, y - index * vy
        disc = np.hypot(x - self.start[0] - index * dx, y - self.start[1] - index * dy) < self.radius
        sky, on = y < self.sky, disc[..., None]
        base = np.where(on, self.disc_base(x, y), self.base(*there))
        base = np.where(sky[..., None], 0.0, base)
        light = np.where(on, self.disc_light, self.light(*there))
        normal = np.where(on, self.disc_normal, (0.0, 0.0, 1.0))
        return {
            "base_color": base,
            "normal": np.where(sky[..., None], 0.0, normal),
            "color": np.where(sky[..., None], (0.3, 0.6, 1.2), base * light),
            "depth": np.where(sky, 0.0, np.where(disc, self.disc_depth, FAR)),
            "motion": np.where(on, (-dx, -dy), (-vx, -vy)),
            "disc": disc.astype(float),
        }

    def frame(self, index: int, size: Size = (64, 36), jitter: Vector = (0.0, 0.0), **over: Any) -> Frame:
        """Sample it once a pixel, at centre + jitter."""
        seen = {name: v.astype(np.float32) for name, v in self.surface(index, *places(size, jitter)).items()}
        scale = np.array(size, np.float32) / np.array(EXTENT, np.float32)
        fields: dict[str, Any] = {
            "color": seen["color"],
            "depth": seen["depth"],
            "motion": seen["motion"] * scale,
            "jitter": jitter,
            "reset": index == 0,
            "exposure": 1.0,
            "gbuffer": {name: seen[name] for name in ("base_color", "normal")},
        }
        return Frame(**{**fields, **over})

    def uncovered(self, index: int) -> NDArray[np.bool_]:
        """(36, 64), True where the disc hid the background a frame ago and no longer does."""
        x, y = places((64, 36))
        now, motion = self.surface(index, x, y)["disc"], self.surface(index, x, y)["motion"]
        before = self.surface(index - 1, x + motion[..., 0], y + motion[..., 1])["disc"]
        return np.asarray((now == 0.0) & (before > 0.0))

    def truth(self, index: int, size: Size, samples: int = 4) -> Float32:
        """Average over each pixel's area: (H, W, 3) linear RGB."""
        total = np.zeros((size[1], size[0], 3))
        for x, y in grids(size, samples):
            total += self.surface(index, x, y)["color"]
        return (total / samples**2).astype(np.float32)
