"""Random materials with their textures: bricks, wood, metals, cloth, leaves, lettering, screens."""

import colorsys
from dataclasses import replace

import numpy as np

from supersampler_model.data.scenes.scene import Color, Material, Rng, Texture, Values

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
                page[row * height : (row + 1) * height, x : x + width] = alphabet[int(rng.integers(GLYPHS))]
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
    return _printed(Texture(pixels=(255.0 * np.clip(page, 0.0, 1.0) + 0.5).astype(np.uint8)), shine)


def _draw_card(rng: Rng, part: Values, card: Color, ink: Color) -> None:
    """Draw a card in place: a paragraph, a chart of bars, a curve, or a table with lines of one pixel."""
    (height, width), accent = part.shape[:2], color(rng, 0.9, 0.9)
    part[:] = card
    kind, inner = int(rng.integers(4)), part[4:-4, 4:-4]
    y, x = np.mgrid[: inner.shape[0], : inner.shape[1]]
    if kind == 0:
        text = lettering(rng, int(rng.integers(6, 16)), max(inner.shape[:2]))
        _ink(inner, text[: inner.shape[0], : inner.shape[1]], ink)
    elif kind == 1:
        bars = np.asarray(rng.uniform(0.1, 0.9, width))[x // 8] * height
        _ink(inner, ((height - y < bars) & (x % 8 < 5)).astype(np.float64), accent)
    elif kind == 2:
        curve = height * (0.5 + 0.35 * np.sin(x / rng.uniform(6.0, 30.0) + rng.uniform(0.0, 6.0)))
        _ink(inner, np.clip(1.6 - np.abs(y - curve), 0.0, 1.0), accent)
    else:
        pitch = int(rng.integers(6, 18))
        _ink(inner, ((y % pitch == 0) | (x % (3 * pitch) == 0)).astype(np.float64), ink)


def _ink(part: Values, cover: Values, color: Color) -> None:
    part += cover[..., None] * (np.array(color) - part)


def _printed(image: Texture, shine: float) -> Material:
    if shine:
        return Material(base_color=(0.02, 0.02, 0.02), emissive=(shine,) * 3, emissive_texture=image)
    return Material(base_color_texture=image, roughness=0.5)


def brick(rng: Rng, rows: int = 12) -> Material:
    """Return a wall of bricks, `rows` on one texture."""
    height, tone = courses(rng, rows, rows // 2, joint=0.12)
    grain = fractal(rng, 0.7)
    red = _any(rng, ((0.55, 0.27, 0.2), (0.62, 0.5, 0.38), (0.4, 0.38, 0.38), (0.7, 0.66, 0.6)))
    field = height * (0.35 + 0.4 * tone + 0.25 * grain)
    return _relief(
        shade(field, _scaled(red, 0.3), _scaled(red, 1.35)), height + 0.25 * grain, 3.0,
        orm(0.95 - 0.2 * height, 0.0, 0.6 + 0.4 * height),
    )  # fmt: skip


def tiles(rng: Rng, count: int, glossy: float, contrast: float = 0.7) -> Material:
    """Return `count` x `count` floor tiles, an even number, checkered or of mixed tones.

    `glossy` is 0 for stoneware and 1 for polished tiles; `contrast`, in [0, 1], is that of the tones.
    """
    height, tone = courses(rng, count, count, joint=0.03, shift=0.0)
    if rng.random() < 0.6:
        tone = checker(count)
    veins = fractal(rng, 1.3)
    hue = np.array(color(rng, 0.15, 0.8))
    field = height * (0.5 + contrast * (tone - 0.5) + 0.2 * (veins - 0.5))
    rough = 0.75 - 0.62 * glossy + 0.12 * veins
    return _relief(shade(field, _scaled(hue, 0.08), _scaled(hue, 1.15)), height, 1.2, orm(rough, 0.0))


def planks(rng: Rng, rows: int = 8, glossy: float = 0.2) -> Material:
    """Return wooden boards, `rows` on one texture."""
    height, tone = courses(rng, rows, 2, joint=0.05, shift=0.37)
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    warp = fractal(rng, 1.8)
    grain = 0.5 + 0.5 * np.sin(2.0 * np.pi * (rows * 4 * y + 3.0 * warp + 2.0 * tone))
    wood = _any(rng, ((0.55, 0.38, 0.24), (0.42, 0.27, 0.16), (0.62, 0.53, 0.42), (0.36, 0.32, 0.3)))
    field = height * (0.3 + 0.45 * tone + 0.25 * grain * (0.7 + 0.3 * np.cos(2.0 * np.pi * x)))
    return _relief(
        shade(field, _scaled(wood, 0.4), _scaled(wood, 1.3)), height + 0.1 * grain, 1.5,
        orm(0.8 - 0.5 * glossy - 0.1 * grain, 0.0),
    )  # fmt: skip


def ground(rng: Rng, hue: Color, slope: float = 0.9, relief: float = 4.0, contrast: float = 1.0) -> Material:
    """Return soil, asphalt, concrete or plaster: noise about a colour, rougher for a small `slope`."""
    coarse, fine = fractal(rng, 1.6), fractal(rng, slope)
    field = 0.5 * coarse + 0.5 * fine
    return _relief(
        shade(field, _scaled(hue, 1.0 - 0.45 * contrast), _scaled(hue, 1.0 + 0.4 * contrast)),
        fine,
        relief,
        orm(0.75 + 0.2 * fine, 0.0),
    )


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
    return Material(
        base_color_texture=texture, roughness=1.0, orm_texture=orm(np.where(window, 0.15, 0.9), 0.0)
    )


def concrete(rng: Rng) -> Material:
    """Return cast concrete."""
    return ground(rng, _scaled((0.55, 0.54, 0.52), rng.uniform(0.6, 1.1)), 1.1, 1.5)


def metal(rng: Rng, hue: Color, roughness: float, worn: float = 0.15) -> Material:
    """Return bare metal with smears; `hue` is its reflectance (linear)."""
    smear = fractal(rng, 1.5)
    return Material(
        base_color=hue, metallic=1.0, roughness=1.0,
        orm_texture=orm(np.clip(roughness + worn * (smear - 0.4), 0.03, 1.0)),
    )  # fmt: skip


def any_metal(rng: Rng, roughness: float) -> Material:
    """Return gold, copper, steel, brass or a blue metal."""
    kinds = ((1.0, 0.72, 0.3), (0.9, 0.55, 0.42), (0.62, 0.6, 0.58), (0.85, 0.75, 0.45), (0.4, 0.5, 0.7))
    return metal(rng, _any(rng, kinds), roughness)


def brushed(rng: Rng, hue: Color) -> Material:
    """Return turned metal: fine grooves that make highlights long."""
    grooves = np.tile(fractal(rng, 0.4)[:1], (SIZE, 1))
    made = metal(rng, hue, 0.22)
    return replace(made, normal_texture=normals(grooves, 0.5))


def paint(rng: Rng, hue: Color | None = None, gloss: float = 0.6) -> Material:
    """Return painted metal with chips and dirt; `hue` is sRGB."""
    dirt, chips = fractal(rng, 1.4), fractal(rng, 0.9) > 0.78
    top = color(rng, 0.75, 0.7) if hue is None else hue
    field = np.where(chips, 0.25, 0.75 + 0.35 * (dirt - 0.5))
    return _relief(
        shade(field, (0.04, 0.04, 0.04), _scaled(top, 1.3)), np.where(chips, 0.0, 1.0), 0.5,
        orm(np.where(chips, 0.8, 0.75 - 0.6 * gloss + 0.2 * dirt), np.where(chips, 0.6, 0.0)),
    )  # fmt: skip


def plates(rng: Rng, hue: Color) -> Material:
    """Return sheet metal with seams and rivets; `hue` is sRGB."""
    seams, tone = courses(rng, 2, 2, joint=0.03, shift=0.0)
    y, x = (np.mgrid[:SIZE, :SIZE] + 0.5) / SIZE
    rim = np.minimum(np.abs(y % 0.5 - 0.04), np.abs(x % 0.5 - 0.04)) < 0.015
    rivets = rim * (np.hypot(x * 16 % 1.0 - 0.5, y * 16 % 1.0 - 0.5) < 0.3)
    rust = np.clip(fractal(rng, 1.2) * 2.0 - 1.1, 0.0, 1.0)
    field = seams * (0.6 + 0.15 * tone + 0.3 * rivets) - 0.4 * rust
    return _relief(
        shade(field, (0.12, 0.07, 0.05), _scaled(hue, 1.3)), seams + rivets, 2.5,
        orm(0.4 + 0.5 * rust, 0.85 * (1.0 - rust)),
    )  # fmt: skip


def striped(rng: Rng, count: int, hue: Color | None = None) -> Material:
    """Return striped cloth, visible from both sides; `hue` is sRGB."""
    weave = 0.12 * (fractal(rng, 0.5) - 0.5)
    texture = shade(stripes(count) + weave, hue or color(rng, 0.8, 0.7), (0.92, 0.9, 0.85))
    return Material(base_color_texture=texture, roughness=0.9, specular=0.2, double_sided=True)


def cloth(rng: Rng, hue: Color | None = None) -> Material:
    """Return plain woven cloth; `hue` is sRGB."""
    y, x = np.mgrid[:SIZE, :SIZE]
    weave = 0.5 + 0.25 * np.sin(x * np.pi / 4.0) + 0.25 * np.sin(y * np.pi / 4.0)
    tone = hue or color(rng, 0.6, 0.6)
    return replace(
        _relief(
            shade(0.7 * weave + 0.3 * fractal(rng, 1.3), _scaled(tone, 0.6), _scaled(tone, 1.2)),
            weave, 1.0, orm(np.full_like(weave, 0.95), 0.0),
        ),
        specular=0.2, double_sided=True,
    )  # fmt: skip


def fence(rng: Rng, meshes: int = 8) -> Material:
    """Return chain-link, `meshes` diamonds on one texture."""
    opacity = chain_link(meshes, rng.uniform(0.12, 0.2))
    rust = fractal(rng, 1.3)
    return _cut_out(shade(rust, (0.45, 0.42, 0.38), (0.85, 0.86, 0.88), opacity), 0.4, 0.7)


def grille(rng: Rng, across: int, down: int, width: float, hue: Color = (0.5, 0.5, 0.5)) -> Material:
    """Return crossing bars with holes between them."""
    opacity = bars(across, down, width)
    return _cut_out(shade(fractal(rng, 1.2), _scaled(hue, 0.6), _scaled(hue, 1.2), opacity), 0.45, 0.6)


def net(rng: Rng, cells: int, width: float, hue: Color = (0.9, 0.9, 0.88)) -> Material:
    """Return a cloth net of square meshes."""
    return replace(grille(rng, cells, cells, width, hue), metallic=0.0, roughness=0.9)


def foliage(rng: Rng, hue: Color, count: int = 7) -> Material:
    """Return leaves on a card; `hue` is sRGB."""
    opacity, tone = leaves(rng, count, rng.uniform(1.6, 3.5))
    return _cut_out(shade(tone, _scaled(hue, 0.45), _scaled(hue, 1.35), opacity), 0.6, 0.0)


def grass(rng: Rng, hue: Color) -> Material:
    """Return blades of grass, dark at the root; `hue` is sRGB."""
    rows = np.linspace(1.0, 0.0, 64)[:, None] * np.ones((1, 64))
    tone = 0.75 * rows + 0.25 * fractal(rng, 0.8, 64)
    texture = shade(tone, _scaled(hue, 0.3), _scaled(hue, 1.35))
    return Material(base_color_texture=texture, roughness=0.65, specular=0.3, double_sided=True)


def glow(color: Color, strength: float) -> Material:
    """Return an emissive material for tubes, bulbs and signs."""
    red, green, blue = (strength * channel for channel in color)
    return Material(base_color=(0.05, 0.05, 0.05), emissive=(red, green, blue))


def poster(rng: Rng, shine: float = 0.0) -> Material:
    """Return a printed image; `shine` makes it a lit screen."""
    image = poster_image(rng)
    if shine:
        return Material(base_color=(0.02, 0.02, 0.02), emissive=(shine,) * 3, emissive_texture=image)
    return Material(base_color_texture=image, roughness=0.55)


def _relief(color: Texture, height: Values, strength: float, orm: Texture) -> Material:
    return Material(
        base_color_texture=color,
        normal_texture=normals(height, strength),
        orm_texture=orm,
        roughness=1.0,
        metallic=1.0,
    )


def _cut_out(color: Texture, roughness: float, metallic: float) -> Material:
    return Material(
        base_color_texture=color, alpha_cutoff=0.5, double_sided=True, roughness=roughness, metallic=metallic
    )


def _scaled(color: "Color | Values", factor: float) -> Color:
    red, green, blue = (float(np.clip(channel * factor, 0.0, 1.0)) for channel in color)
    return red, green, blue


def _any(rng: Rng, colors: tuple[Color, ...]) -> Color:
    return colors[int(rng.integers(len(colors)))]
