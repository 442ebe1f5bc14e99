"""Procedural textures, which repeat. Fields are (size, size) in [0, 1]; colours are sRGB in [0, 1]."""

import colorsys

import numpy as np

from supersampler_model.data.scenes.scene import Texture
from supersampler_model.data.values import Color, Rng, Values

SIZE = 256


def fractal(rng: Rng, slope: float = 1.2, size: int = SIZE) -> Values:
    """Return noise whose amplitude falls with frequency to the power `slope`: 0.5 is gritty, 2 is clouds."""
    y, x = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    frequency = np.hypot(x, y) * size
    waves = np.fft.fft2(rng.standard_normal((size, size)))
    shaped = waves * np.where(frequency > 0.5, np.maximum(frequency, 1.0) ** -slope, 0.0)
    image = np.fft.ifft2(shaped).real
    return np.asarray(np.clip(0.5 + image / (5.0 * image.std()), 0.0, 1.0))


def courses(
    rng: Rng, rows: int, columns: int, *, joint: float = 0.06, shift: float = 0.5
) -> tuple[Values, Values]:
    """Return bricks, tiles or planks: their height in [0, 1], 0 in the joints, and random tones.

    Joints are `joint` rows wide; every other row is shifted by `shift` columns, for an even number of rows.
    """
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    row = np.floor(y * rows).astype(int)
    along = x * columns + shift * (row % 2)
    column = np.floor(along).astype(int) % columns
    down, across = y * rows - row, along - np.floor(along)
    aspect = rows / columns
    rim = np.minimum(np.minimum(down, 1.0 - down), np.minimum(across, 1.0 - across) * aspect)
    return np.clip(rim / joint - 0.5, 0.0, 1.0), rng.uniform(0.0, 1.0, (rows, columns))[row, column]


def checker(cells: int) -> Values:
    """Return 0 and 1 in `cells` x `cells` squares, an even number."""
    cell = np.arange(SIZE) * cells // SIZE
    return ((cell[:, None] + cell) % 2).astype(np.float64)


def stripes(count: int) -> Values:
    """Return `count` stripes of 1 along v, on 0."""
    return np.tile((np.arange(SIZE) * 2 * count // SIZE % 2).astype(np.float64), (SIZE, 1))


def shade(field: Values, dark: Color, bright: Color, opacity: Values | None = None) -> Texture:
    """Return the colours from `dark` at 0 to `bright` at 1, with an opacity if one is given."""
    pixels = np.array(dark) + np.clip(field, 0.0, 1.0)[..., None] * (np.array(bright) - dark)
    if opacity is not None:
        pixels = np.concatenate([pixels, opacity[..., None]], axis=-1)
    return Texture(pixels=(255.0 * np.clip(pixels, 0.0, 1.0) + 0.5).astype(np.uint8))


def normals(height: Values, strength: float) -> Texture:
    """Return the normal map of a relief; `strength` is its height in texels."""
    slope_x, slope_y = (
        (np.roll(height, 1, axis) - np.roll(height, -1, axis)) * strength / 2.0 for axis in (1, 0)
    )
    field = np.stack([slope_x, -slope_y, np.ones_like(height)], axis=-1)  # green points up the image
    field /= np.linalg.norm(field, axis=-1, keepdims=True)
    return Texture(pixels=(127.5 * field + 127.5).round().astype(np.uint8), srgb=False)


def orm(roughness: Values, metallic: float | Values = 1.0, occlusion: float | Values = 1.0) -> Texture:
    """Return an occlusion, roughness, metallic map, which multiplies the material's constants."""
    channels = np.broadcast_arrays(occlusion, roughness, metallic)
    pixels = 255.0 * np.clip(np.stack(channels, axis=-1), 0.0, 1.0) + 0.5
    return Texture(pixels=pixels.astype(np.uint8), srgb=False)


def chain_link(meshes: int, wire: float) -> Values:
    """Return the opacity of `meshes` x `meshes` diamonds of wire, `wire` of a diamond thick."""
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE * meshes
    near = np.minimum(np.abs((x + y) % 1.0 - 0.5), np.abs((x - y) % 1.0 - 0.5))
    return np.asarray(np.clip(0.5 + (wire / 2.0 - near) * SIZE / meshes / 2.0, 0.0, 1.0))


def bars(across: int, down: int, width: float) -> Values:
    """Return the opacity of a grille of crossing bars, each `width` of its cell."""
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    fields = [
        np.clip(0.5 + (width / 2.0 - np.abs(axis * count % 1.0 - 0.5)) * SIZE / count, 0.0, 1.0)
        for axis, count in ((x, across), (y, down))
        if count
    ]
    return np.asarray(np.max(fields, axis=0))


def leaves(rng: Rng, count: int, slim: float) -> tuple[Values, Values]:
    """Return opacity and tone of `count` leaves around the middle, `slim` times as long as wide."""
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE - 0.5
    opacity, tone = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    for index in range(count):
        angle = 2.0 * np.pi * (index + rng.uniform(-0.3, 0.3)) / count
        along = x * np.cos(angle) + y * np.sin(angle)
        across = np.abs(y * np.cos(angle) - x * np.sin(angle))
        t = np.clip((along - 0.04) / rng.uniform(0.32, 0.44), 0.0, 1.0)
        width = np.sin(np.pi * np.sqrt(t)) * 0.4 / slim
        inside = np.clip(0.5 + (width - across) * SIZE / 2.0, 0.0, 1.0) * (t > 0.0)
        vein = 0.25 * (across < 0.006)
        tone = np.where(inside > 0.5, rng.uniform(0.3, 1.0) - vein, tone)
        opacity = np.maximum(opacity, inside)
    return opacity, tone


def poster_image(rng: Rng) -> Texture:
    """Return a poster: a ground, bold shapes, and lines of fine marks like print."""
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    image = np.broadcast_to(np.array(color(rng, 0.5, 0.8)), (SIZE, SIZE, 3)).copy()
    for _ in range(int(rng.integers(3, 7))):
        cx, cy, extent = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9), rng.uniform(0.08, 0.35)
        round_one = np.hypot(x - cx, y - cy) < extent
        square = np.maximum(np.abs(x - cx), 2.0 * np.abs(y - cy)) < extent
        image[round_one if rng.random() < 0.5 else square] = color(rng, 0.8, rng.uniform(0.2, 1.0))
    ink = color(rng, 0.3, 0.15 if image.mean() > 0.4 else 0.95)
    letters = rng.random((SIZE // 8, SIZE // 4)).repeat(8, 0).repeat(4, 1) < 0.6
    lines = (y * SIZE % 16 > 5) & (y > 0.72) & (y < 0.94) & (x > 0.1) & (x < 0.9)
    image[letters & lines] = ink
    return Texture(pixels=(255.0 * image + 0.5).astype(np.uint8))


def color(rng: Rng, saturation: float, value: float) -> Color:
    """Return a colour of any hue, about as saturated and as bright as asked."""
    s = saturation * rng.uniform(0.45, 1.1)
    v = value * rng.uniform(0.7, 1.15)
    return colorsys.hsv_to_rgb(rng.random(), min(s, 1.0), min(v, 1.0))
