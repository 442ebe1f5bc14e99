"""Random materials with their textures: bricks, wood, metals, cloth, leaves, lettering, screens."""

import colorsys
from dataclasses import replace
from typing import TypeVar

import numpy as np

from supersampler_model.data.scenes.scene import Color, Material, Rng, Texture, Values

SIZE = 256  # texels a side
V, U = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE  # texture coordinates of the texel centres
Option = TypeVar("Option")


def one_of(rng: Rng, *options: Option) -> Option:
    """Return one of the options."""
    return options[int(rng.integers(len(options)))]


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
    row = np.floor(V * rows).astype(int)
    along = U * columns + shift * (row % 2)
    column = np.floor(along).astype(int) % columns
    down, across = V * rows - row, along - np.floor(along)
    aspect = rows / columns
    rim = np.minimum(np.minimum(down, 1.0 - down), np.minimum(across, 1.0 - across) * aspect)
    return np.clip(rim / joint - 0.5, 0.0, 1.0), rng.uniform(0.0, 1.0, (rows, columns))[row, column]


def shade(field: Values, dark: Color, bright: Color, opacity: Values | None = None) -> Texture:
    """Return the colours from `dark` at 0 to `bright` at 1, with an opacity if one is given."""
    pixels = np.array(dark) + np.clip(field, 0.0, 1.0)[..., None] * (np.array(bright) - dark)
    return _texture(pixels if opacity is None else np.concatenate([pixels, opacity[..., None]], axis=-1))


def _shades(
    field: Values, hue: Color | Values, dark: float, bright: float, opacity: Values | None = None
) -> Texture:
    """Return `shade` from `dark` to `bright` times a colour."""
    return shade(field, _scaled(hue, dark), _scaled(hue, bright), opacity)


def _scaled(color: Color | Values, factor: float) -> Color:
    red, green, blue = (float(np.clip(channel * factor, 0.0, 1.0)) for channel in color)
    return red, green, blue


def _texture(pixels: Values, *, srgb: bool = True) -> Texture:
    return Texture(pixels=(255.0 * np.clip(pixels, 0.0, 1.0) + 0.5).astype(np.uint8), srgb=srgb)


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
    return _texture(np.stack(np.broadcast_arrays(occlusion, roughness, metallic), axis=-1), srgb=False)


def color(rng: Rng, saturation: float, value: float) -> Color:
    """Return a colour of random hue, of about this saturation and value."""
    s = saturation * rng.uniform(0.45, 1.1)
    v = value * rng.uniform(0.7, 1.15)
    return colorsys.hsv_to_rgb(rng.random(), min(s, 1.0), min(v, 1.0))


PAGE = 512
GLYPHS = 16  # of an alphabet
_POINTS = tuple((x, y) for y in (0.12, 0.45, 0.78) for x in (0.12, 0.44, 0.76))
_STROKES = ((0, 2), (0, 6), (2, 8), (6, 8), (3, 5), (1, 7), (0, 8), (2, 6), (0, 4), (4, 8), (3, 6), (5, 8))
"""A glyph is some of these lines between two of _POINTS, (x, y) in its cell, [0, 1]."""


def lettering(rng: Rng, rows: int, size: int = PAGE) -> Values:
    """Return `rows` lines of random words: the coverage of the ink, (size, size) in [0, 1]."""
    page, height = np.zeros((size, size)), size // rows
    width = max(int(0.62 * height), 2)
    alphabet = [_glyph(rng, height, width) for _ in range(GLYPHS)]
    for row in range(rows):
        end = int(size * rng.uniform(0.55, 0.97))
        x, word = int(0.03 * size), int(rng.integers(2, 9))
        while x + width < end:
            if word:
                page[row * height : (row + 1) * height, x : x + width] = one_of(rng, *alphabet)
                word -= 1
            else:
                word = int(rng.integers(2, 9))
            x += width
    return page


def _glyph(rng: Rng, height: int, width: int) -> Values:
    y, x = (np.mgrid[:height, :width] + 0.5) / np.array([height, width]).reshape(2, 1, 1)
    ink = np.zeros((height, width))
    for index in rng.choice(len(_STROKES), int(rng.integers(3, 6)), replace=False):
        (ax, ay), (bx, by) = (np.array(_POINTS[i]) for i in _STROKES[index])
        along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        t = np.clip(along, 0.0, 1.0)
        away = np.hypot(x - ax - t * (bx - ax), y - ay - t * (by - ay))
        ink = np.maximum(ink, np.clip(0.5 + (0.08 - away) * height, 0.0, 1.0))
    return ink


def sign(rng: Rng, rows: int, shine: float = 0.0) -> Material:
    """Return a board with `rows` lines of lettering; `shine` > 0 is the radiance of a lit one."""
    ink = color(rng, 0.7, 0.25)
    paper = (0.95, 0.94, 0.9) if rng.random() < 0.5 else color(rng, 0.8, 0.9)
    dark, bright = (paper, ink) if rng.random() < 0.6 else (ink, paper)
    return _printed(shade(lettering(rng, rows), dark, bright), shine)


def screen(rng: Rng, shine: float) -> Material:
    """Return a screen of radiance `shine` with a header and cards of text, charts and tables."""
    dark = rng.random() < 0.6
    ground, card = ((0.09, 0.1, 0.12), (0.17, 0.18, 0.22)) if dark else ((0.9, 0.91, 0.93), (1.0, 1.0, 1.0))
    ink: Color = (0.88, 0.9, 0.93) if dark else (0.12, 0.13, 0.16)
    page = np.empty((PAGE, PAGE, 3))
    page[:] = ground
    page[: PAGE // 12] = color(rng, 0.8, 0.8)
    columns, gap = int(rng.integers(2, 4)), PAGE // 64
    width, top, height = PAGE // columns, PAGE // 12 + gap, PAGE // 3
    while top + height // 2 < PAGE:
        for column in range(columns):
            rows = slice(top, min(top + height, PAGE) - gap)
            _draw_card(rng, page[rows, column * width + gap : (column + 1) * width - gap], card, ink)
        top, height = top + height, int(rng.integers(PAGE // 6, PAGE // 2))
    return _printed(_texture(page), shine)


def _draw_card(rng: Rng, part: Values, card: Color, ink: Color) -> None:
    """Draw a card in place: a paragraph, a chart of bars, a curve, or a table with lines of one pixel."""
    (height, width), accent = part.shape[:2], color(rng, 0.9, 0.9)
    part[:] = card
    kind, inner = int(rng.integers(4)), part[4:-4, 4:-4]
    y, x = np.mgrid[: inner.shape[0], : inner.shape[1]]
    if kind == 0:
        text = lettering(rng, int(rng.integers(6, 16)), max(inner.shape[:2]))
        cover = text[: inner.shape[0], : inner.shape[1]]
    elif kind == 1:
        bars = np.asarray(rng.uniform(0.1, 0.9, width))[x // 8] * height
        cover = ((height - y < bars) & (x % 8 < 5)).astype(np.float64)
    elif kind == 2:
        curve = height * (0.5 + 0.35 * np.sin(x / rng.uniform(6.0, 30.0) + rng.uniform(0.0, 6.0)))
        cover = np.clip(1.6 - np.abs(y - curve), 0.0, 1.0)
    else:
        pitch = int(rng.integers(6, 18))
        cover = ((y % pitch == 0) | (x % (3 * pitch) == 0)).astype(np.float64)
    inner += cover[..., None] * (np.array(accent if kind in (1, 2) else ink) - inner)


def poster(rng: Rng, shine: float = 0.0) -> Material:
    """Return a printed image of bold shapes and lines of fine marks; `shine` makes it a lit screen."""
    image = np.broadcast_to(np.array(color(rng, 0.5, 0.8)), (SIZE, SIZE, 3)).copy()
    for _ in range(int(rng.integers(3, 7))):
        cx, cy, extent = rng.uniform(0.1, 0.9), rng.uniform(0.1, 0.9), rng.uniform(0.08, 0.35)
        disc = np.hypot(U - cx, V - cy) < extent
        rectangle = np.maximum(np.abs(U - cx), 2.0 * np.abs(V - cy)) < extent
        image[disc if rng.random() < 0.5 else rectangle] = color(rng, 0.8, rng.uniform(0.2, 1.0))
    ink = color(rng, 0.3, 0.15 if image.mean() > 0.4 else 0.95)
    letters = rng.random((SIZE // 8, SIZE // 4)).repeat(8, 0).repeat(4, 1) < 0.6
    lines = (V * SIZE % 16 > 5) & (V > 0.72) & (V < 0.94) & (U > 0.1) & (U < 0.9)
    image[letters & lines] = ink
    return _printed(_texture(image), shine, 0.55)


def _printed(image: Texture, shine: float, roughness: float = 0.5) -> Material:
    if shine:
        return Material(base_color=(0.02, 0.02, 0.02), emissive=(shine,) * 3, emissive_texture=image)
    return Material(base_color_texture=image, roughness=roughness)


def brick(rng: Rng, rows: int = 12) -> Material:
    """Return a wall of bricks, `rows` on one texture."""
    height, tone = courses(rng, rows, rows // 2, joint=0.12)
    grain = fractal(rng, 0.7)
    red = one_of(rng, (0.55, 0.27, 0.2), (0.62, 0.5, 0.38), (0.4, 0.38, 0.38), (0.7, 0.66, 0.6))
    field = height * (0.35 + 0.4 * tone + 0.25 * grain)
    surface = orm(0.95 - 0.2 * height, 0.0, 0.6 + 0.4 * height)
    return _relief(_shades(field, red, 0.3, 1.35), height + 0.25 * grain, 3.0, surface)


def tiles(rng: Rng, count: int, glossy: float, contrast: float = 0.7) -> Material:
    """Return `count` x `count` floor tiles, an even number, checkered or of mixed tones.

    `glossy` is 0 for stoneware and 1 for polished tiles; `contrast`, in [0, 1], is the contrast of tones.
    """
    height, tone = courses(rng, count, count, joint=0.03, shift=0.0)
    if rng.random() < 0.6:
        cell = np.arange(SIZE) * count // SIZE
        tone = ((cell[:, None] + cell) % 2).astype(np.float64)
    veins = fractal(rng, 1.3)
    hue = np.array(color(rng, 0.15, 0.8))
    field = height * (0.5 + contrast * (tone - 0.5) + 0.2 * (veins - 0.5))
    rough = 0.75 - 0.62 * glossy + 0.12 * veins
    return _relief(_shades(field, hue, 0.08, 1.15), height, 1.2, orm(rough, 0.0))


def planks(rng: Rng, rows: int = 8, glossy: float = 0.2) -> Material:
    """Return wooden boards, `rows` on one texture."""
    height, tone = courses(rng, rows, 2, joint=0.05, shift=0.37)
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    warp = fractal(rng, 1.8)
    grain = 0.5 + 0.5 * np.sin(2.0 * np.pi * (rows * 4 * y + 3.0 * warp + 2.0 * tone))
    wood = one_of(rng, (0.55, 0.38, 0.24), (0.42, 0.27, 0.16), (0.62, 0.53, 0.42), (0.36, 0.32, 0.3))
    field = height * (0.3 + 0.45 * tone + 0.25 * grain * (0.7 + 0.3 * np.cos(2.0 * np.pi * x)))
    rough = orm(0.8 - 0.5 * glossy - 0.1 * grain, 0.0)
    return _relief(_shades(field, wood, 0.4, 1.3), height + 0.1 * grain, 1.5, rough)


def ground(rng: Rng, hue: Color, slope: float = 0.9, relief: float = 4.0, contrast: float = 1.0) -> Material:
    """Return soil, asphalt, concrete or plaster: noise about a colour, rougher for a small `slope`."""
    coarse, fine = fractal(rng, 1.6), fractal(rng, slope)
    color = _shades(0.5 * coarse + 0.5 * fine, hue, 1.0 - 0.45 * contrast, 1.0 + 0.4 * contrast)
    return _relief(color, fine, relief, orm(0.75 + 0.2 * fine, 0.0))


def plaster(rng: Rng, hue: Color) -> Material:
    """Return plaster, marble or skin: nearly even; `hue` is sRGB."""
    return ground(rng, hue, 1.2, 0.4, 0.3)


def facade(rng: Rng) -> Material:
    """Return a house front with 8 x 8 windows per texture; some are dark, some reflect the sky."""
    wall, tone = courses(rng, 8, 8, joint=0.3, shift=0.0)
    window = wall > 0.45
    stone = np.array(color(rng, 0.25, 0.5))
    pixels = np.where(window[..., None], 0.1 + 0.3 * tone[..., None] * (0.8, 0.9, 1.0), stone)
    texture = Texture(pixels=(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8))
    rough = orm(np.where(window, 0.15, 0.9), 0.0)
    return Material(base_color_texture=texture, roughness=1.0, orm_texture=rough)


def concrete(rng: Rng) -> Material:
    """Return cast concrete."""
    return ground(rng, _scaled((0.55, 0.54, 0.52), rng.uniform(0.6, 1.1)), 1.1, 1.5)


def metal(rng: Rng, hue: Color, roughness: float, worn: float = 0.15) -> Material:
    """Return bare metal with smears; `hue` is its reflectance (linear)."""
    smeared = np.clip(roughness + worn * (fractal(rng, 1.5) - 0.4), 0.03, 1.0)
    return Material(base_color=hue, metallic=1.0, roughness=1.0, orm_texture=orm(smeared))


def any_metal(rng: Rng, roughness: float) -> Material:
    """Return gold, copper, steel, brass or a blue metal."""
    gold, copper, steel = (1.0, 0.72, 0.3), (0.9, 0.55, 0.42), (0.62, 0.6, 0.58)
    return metal(rng, one_of(rng, gold, copper, steel, (0.85, 0.75, 0.45), (0.4, 0.5, 0.7)), roughness)


def brushed(rng: Rng, hue: Color) -> Material:
    """Return turned metal: fine grooves that make highlights long."""
    grooves = np.tile(fractal(rng, 0.4)[:1], (SIZE, 1))
    return replace(metal(rng, hue, 0.22), normal_texture=normals(grooves, 0.5))


def paint(rng: Rng, hue: Color | None = None, gloss: float = 0.6) -> Material:
    """Return painted metal with chips and dirt; `hue` is sRGB."""
    dirt, chips = fractal(rng, 1.4), fractal(rng, 0.9) > 0.78
    top = color(rng, 0.75, 0.7) if hue is None else hue
    field = np.where(chips, 0.25, 0.75 + 0.35 * (dirt - 0.5))
    surface = orm(np.where(chips, 0.8, 0.75 - 0.6 * gloss + 0.2 * dirt), np.where(chips, 0.6, 0.0))
    return _relief(
        shade(field, (0.04, 0.04, 0.04), _scaled(top, 1.3)), np.where(chips, 0.0, 1.0), 0.5, surface
    )


def plates(rng: Rng, hue: Color) -> Material:
    """Return sheet metal with seams and rivets; `hue` is sRGB."""
    seams, tone = courses(rng, 2, 2, joint=0.03, shift=0.0)
    rim = np.minimum(np.abs(V % 0.5 - 0.04), np.abs(U % 0.5 - 0.04)) < 0.015
    rivets = rim * (np.hypot(U * 16 % 1.0 - 0.5, V * 16 % 1.0 - 0.5) < 0.3)
    rust = np.clip(fractal(rng, 1.2) * 2.0 - 1.1, 0.0, 1.0)
    field = seams * (0.6 + 0.15 * tone + 0.3 * rivets) - 0.4 * rust
    surface = orm(0.4 + 0.5 * rust, 0.85 * (1.0 - rust))
    return _relief(shade(field, (0.12, 0.07, 0.05), _scaled(hue, 1.3)), seams + rivets, 2.5, surface)


def striped(rng: Rng, count: int, hue: Color | None = None) -> Material:
    """Return cloth with `count` stripes along v, visible from both sides; `hue` is sRGB."""
    weave = 0.12 * (fractal(rng, 0.5) - 0.5)
    stripes = np.tile((np.arange(SIZE) * 2 * count // SIZE % 2).astype(np.float64), (SIZE, 1))
    texture = shade(stripes + weave, hue or color(rng, 0.8, 0.7), (0.92, 0.9, 0.85))
    return Material(base_color_texture=texture, roughness=0.9, specular=0.2, double_sided=True)


def cloth(rng: Rng, hue: Color | None = None) -> Material:
    """Return plain woven cloth; `hue` is sRGB."""
    y, x = np.mgrid[:SIZE, :SIZE]
    weave = 0.5 + 0.25 * np.sin(x * np.pi / 4.0) + 0.25 * np.sin(y * np.pi / 4.0)
    tone = hue or color(rng, 0.6, 0.6)
    texture = _shades(0.7 * weave + 0.3 * fractal(rng, 1.3), tone, 0.6, 1.2)
    woven = _relief(texture, weave, 1.0, orm(np.full_like(weave, 0.95), 0.0))
    return replace(woven, specular=0.2, double_sided=True)


def fence(rng: Rng, meshes: int = 8) -> Material:
    """Return chain-link: `meshes` x `meshes` diamonds of wire on one texture."""
    wire = rng.uniform(0.12, 0.2)  # thickness, fraction of a diamond
    y, x = V * meshes, U * meshes
    near = np.minimum(np.abs((x + y) % 1.0 - 0.5), np.abs((x - y) % 1.0 - 0.5))
    opacity = np.clip(0.5 + (wire / 2.0 - near) * SIZE / meshes / 2.0, 0.0, 1.0)
    return _cut_out(shade(fractal(rng, 1.3), (0.45, 0.42, 0.38), (0.85, 0.86, 0.88), opacity), 0.4, 0.7)


def grille(rng: Rng, across: int, down: int, width: float, hue: Color = (0.5, 0.5, 0.5)) -> Material:
    """Return crossing bars with holes between them; a bar takes `width` of its cell."""
    bars = [
        np.clip(0.5 + (width / 2.0 - np.abs(axis * count % 1.0 - 0.5)) * SIZE / count, 0.0, 1.0)
        for axis, count in ((U, across), (V, down))
    ]
    return _cut_out(_shades(fractal(rng, 1.2), hue, 0.6, 1.2, np.maximum(*bars)), 0.45, 0.6)


def net(rng: Rng, cells: int, width: float, hue: Color = (0.9, 0.9, 0.88)) -> Material:
    """Return a cloth net of square meshes."""
    return replace(grille(rng, cells, cells, width, hue), metallic=0.0, roughness=0.9)


def foliage(rng: Rng, hue: Color, count: int = 7) -> Material:
    """Return a card of `count` leaves around its middle; `hue` is sRGB."""
    y, x, slim = V - 0.5, U - 0.5, rng.uniform(1.6, 3.5)  # slim: length over width
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
    return _cut_out(_shades(tone, hue, 0.45, 1.35, opacity), 0.6, 0.0)


def grass(rng: Rng, hue: Color) -> Material:
    """Return blades of grass, dark at the root; `hue` is sRGB."""
    rows = np.linspace(1.0, 0.0, 64)[:, None] * np.ones((1, 64))
    texture = _shades(0.75 * rows + 0.25 * fractal(rng, 0.8, 64), hue, 0.3, 1.35)
    return Material(base_color_texture=texture, roughness=0.65, specular=0.3, double_sided=True)


def glow(color: Color, strength: float) -> Material:
    """Return an emissive material for tubes, bulbs and signs."""
    red, green, blue = (strength * channel for channel in color)
    return Material(base_color=(0.05, 0.05, 0.05), emissive=(red, green, blue))


def _relief(color: Texture, height: Values, strength: float, orm: Texture) -> Material:
    return Material(
        base_color_texture=color, normal_texture=normals(height, strength), orm_texture=orm, roughness=1.0,
        metallic=1.0,
    )  # fmt: skip


def _cut_out(color: Texture, roughness: float, metallic: float) -> Material:
    return Material(
        base_color_texture=color, alpha_cutoff=0.5, double_sided=True, roughness=roughness, metallic=metallic
    )
