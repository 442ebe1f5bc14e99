"""The contents of the uniform blocks of shaders/*.glsl, in std140 layout."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.lights import MAX_POINTS, Spot, Sun
from supersampler_model.data.scenes.scene import MAX_JOINTS, Instance, Scene

Values = NDArray[np.float64]
Size = tuple[int, int]
DRAW_BYTES = 256  # per instance; a multiple of every GL's offset alignment
PALETTES_BYTES = 2 * MAX_JOINTS * 64
SHADOW_SIZE = 2048  # texels a side, of the sun's map; the spot's has half as many


@dataclass(frozen=True, slots=True)
class Raster:
    """A grid of samples over a part of the image.

    Attributes:
        size: samples (x, y).
        corner, extent: the part, in units of the image: (0, 0) is its top left corner, (1, 1) the other.
        pixels: size of the image in which motion is counted.
        filter_width: width of the texture filter in samples of this grid: a display pixel's.
    """

    size: Size
    corner: tuple[float, float]
    extent: tuple[float, float]
    pixels: Size
    filter_width: float = 1.0

    @classmethod
    def of_frame(
        cls, size: Size, jitter: tuple[float, float] = (0.0, 0.0), filter_width: float = 1.0
    ) -> "Raster":
        """One sample a pixel at its centre + jitter."""
        return cls(size, (jitter[0] / size[0], jitter[1] / size[1]), (1.0, 1.0), size, filter_width)

    def window(self) -> list[float]:
        """Scale x, y and offset x, y that map this part of clip space to [-1, 1]."""
        scale = [1.0 / extent for extent in self.extent]
        middles = [
            2.0 * corner + extent - 1.0 for corner, extent in zip(self.corner, self.extent, strict=True)
        ]
        return [*scale, *(-middle * factor for middle, factor in zip(middles, scale, strict=True))]


def columns(*matrices: Values) -> bytes:
    """Return matrices (..., 4, 4) column by column, as GL reads them."""
    return b"".join(np.ascontiguousarray(np.swapaxes(m, -1, -2), np.float32).tobytes() for m in matrices)


def rows(*vectors: Any) -> bytes:
    """Return vectors of up to four numbers, each filled up with zeros."""
    return b"".join(np.array([*v, *[0.0] * (4 - len(v))], np.float32).tobytes() for v in vectors)


def view_block(scene: Scene, aspect: float, raster: Raster) -> bytes:
    """Return block View: the camera now and before, and the rendered part of the image."""
    camera, view = scene.camera, scene.camera.view()
    projection = camera.projection(aspect)
    before = scene.camera_before.projection(aspect) @ scene.camera_before.view()
    rays = np.zeros((4, 4))
    rays[:3, :3] = view[:3, :3].T @ np.diag([1.0 / projection[0, 0], 1.0 / projection[1, 1], -1.0])
    vectors = rows(
        raster.window(), (*camera.position, camera.near), view[0, :3], view[1, :3],
        (*raster.pixels, raster.filter_width),
    )  # fmt: skip
    return columns(projection @ view, before, rays) + vectors


def draw_blocks(instances: tuple[Instance, ...]) -> bytes:
    """Return block Draw of each instance, each `DRAW_BYTES` long."""
    blocks = []
    for instance in instances:
        normal = np.eye(4)
        normal[:3, :3] = np.linalg.inv(instance.model[:3, :3]).T
        block = columns(instance.model, _before(instance), normal) + rows((instance.emission,))
        blocks.append(block.ljust(DRAW_BYTES, b"\0"))
    return b"".join(blocks)


def palette_blocks(instances: list[Instance]) -> bytes:
    """Return block Palettes of each skinned instance, each `PALETTES_BYTES` long."""
    blocks = []
    for instance in instances:
        palettes = np.zeros((2, MAX_JOINTS, 4, 4))
        palettes[0, : len(_palette(instance.palette))] = instance.palette
        palettes[1, : len(_palette(instance.palette_before))] = instance.palette_before
        blocks.append(columns(palettes))
    return b"".join(blocks)


def lights_block(scene: Scene, irradiance: Values, panorama_height: int, levels: int) -> bytes:
    """Return block Lights."""
    sun = scene.sun or Sun(direction=(0.0, -1.0, 0.0), color=(0.0, 0.0, 0.0))
    spot = scene.spot or Spot(position=(0.0, 1.0, 0.0), target=(0.0, 0.0, 0.0), color=(0.0, 0.0, 0.0))
    to_sun = -np.array(sun.direction) / np.linalg.norm(sun.direction)
    axis = np.subtract(spot.target, spot.position)
    axis = axis / np.linalg.norm(axis)
    outer, inner = np.cos(np.radians([spot.outer, min(spot.inner, spot.outer - 1e-3)]))
    spot_texel = 2.0 * np.tan(np.radians(spot.outer)) / (SHADOW_SIZE // 2)
    vectors = [
        (*to_sun, 2.0 * sun.radius / SHADOW_SIZE), sun.color,
        (*spot.position, spot.reach), (*axis, spot_texel), (*spot.color, inner),
        (len(scene.points), outer),
        (levels, np.log2(panorama_height / np.pi)),
    ]  # fmt: skip
    padding = [(0.0,)] * (MAX_POINTS - len(scene.points))
    points = [*((*point.position, point.reach) for point in scene.points), *padding]
    colors = [*(point.color for point in scene.points), *padding]
    return columns(sun.matrix(), spot.matrix()) + rows(*vectors, *irradiance, *points, *colors)


def _before(instance: Instance) -> Values:
    assert instance.model_before is not None  # noqa: S101 - Instance fills it in
    return instance.model_before


def _palette(palette: Values | None) -> Values:
    assert palette is not None  # noqa: S101 - Instance has checked that a skinned mesh has one
    return palette
