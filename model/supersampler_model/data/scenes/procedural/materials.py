"""Random materials: bricks, tiles, wood, metals, cloth, leaves and others, with their textures."""

from dataclasses import replace

import numpy as np

from supersampler_model.data.scenes.procedural import textures
from supersampler_model.data.scenes.procedural.textures import shade
from supersampler_model.data.scenes.scene import Material, Texture
from supersampler_model.data.values import Color, Rng, Values


def brick(rng: Rng, rows: int = 12) -> Material:
    """Return a wall of bricks, `rows` on one texture."""
    height, tone = textures.courses(rng, rows, rows // 2, joint=0.12)
    grain = textures.fractal(rng, 0.7)
    red = _any(rng, ((0.55, 0.27, 0.2), (0.62, 0.5, 0.38), (0.4, 0.38, 0.38), (0.7, 0.66, 0.6)))
    field = height * (0.35 + 0.4 * tone + 0.25 * grain)
    return _relief(
        shade(field, _scaled(red, 0.3), _scaled(red, 1.35)), height + 0.25 * grain, 3.0,
        textures.orm(0.95 - 0.2 * height, 0.0, 0.6 + 0.4 * height),
    )  # fmt: skip


def tiles(rng: Rng, count: int, glossy: float, contrast: float = 0.7) -> Material:
    """Return `count` x `count` floor tiles, an even number, checkered or of mixed tones.

    `glossy` is 0 for stoneware and 1 for polished tiles; `contrast`, in [0, 1], is that of the tones.
    """
    height, tone = textures.courses(rng, count, count, joint=0.03, shift=0.0)
    if rng.random() < 0.6:
        tone = textures.checker(count)
    veins = textures.fractal(rng, 1.3)
    hue = np.array(textures.color(rng, 0.15, 0.8))
    field = height * (0.5 + contrast * (tone - 0.5) + 0.2 * (veins - 0.5))
    rough = 0.75 - 0.62 * glossy + 0.12 * veins
    return _relief(
        shade(field, _scaled(hue, 0.08), _scaled(hue, 1.15)), height, 1.2, textures.orm(rough, 0.0)
    )


def planks(rng: Rng, rows: int = 8, glossy: float = 0.2) -> Material:
    """Return wooden boards, `rows` on one texture."""
    height, tone = textures.courses(rng, rows, 2, joint=0.05, shift=0.37)
    y, x = np.mgrid[: textures.SIZE, : textures.SIZE] / textures.SIZE
    warp = textures.fractal(rng, 1.8)
    grain = 0.5 + 0.5 * np.sin(2.0 * np.pi * (rows * 4 * y + 3.0 * warp + 2.0 * tone))
    wood = _any(rng, ((0.55, 0.38, 0.24), (0.42, 0.27, 0.16), (0.62, 0.53, 0.42), (0.36, 0.32, 0.3)))
    field = height * (0.3 + 0.45 * tone + 0.25 * grain * (0.7 + 0.3 * np.cos(2.0 * np.pi * x)))
    return _relief(
        shade(field, _scaled(wood, 0.4), _scaled(wood, 1.3)), height + 0.1 * grain, 1.5,
        textures.orm(0.8 - 0.5 * glossy - 0.1 * grain, 0.0),
    )  # fmt: skip


def ground(rng: Rng, hue: Color, slope: float = 0.9, relief: float = 4.0, contrast: float = 1.0) -> Material:
    """Return soil, asphalt, concrete or plaster: noise about a colour, rougher for a small `slope`."""
    coarse, fine = textures.fractal(rng, 1.6), textures.fractal(rng, slope)
    field = 0.5 * coarse + 0.5 * fine
    return _relief(
        shade(field, _scaled(hue, 1.0 - 0.45 * contrast), _scaled(hue, 1.0 + 0.4 * contrast)),
        fine,
        relief,
        textures.orm(0.75 + 0.2 * fine, 0.0),
    )


def plaster(rng: Rng, hue: Color) -> Material:
    """Return plaster, marble or skin: nearly even; `hue` is sRGB."""
    return ground(rng, hue, 1.2, 0.4, 0.3)


def facade(rng: Rng) -> Material:
    """Return a house front with 8 x 8 windows per texture; some are dark, some reflect the sky."""
    wall, tone = textures.courses(rng, 8, 8, joint=0.3, shift=0.0)
    window = wall > 0.45
    stone = np.array(textures.color(rng, 0.25, 0.5))
    pixels = np.where(window[..., None], 0.1 + 0.3 * tone[..., None] * (0.8, 0.9, 1.0), stone)
    texture = Texture(pixels=(255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8))
    return Material(
        base_color_texture=texture, roughness=1.0, orm_texture=textures.orm(np.where(window, 0.15, 0.9), 0.0)
    )


def concrete(rng: Rng) -> Material:
    """Return cast concrete."""
    return ground(rng, _scaled((0.55, 0.54, 0.52), rng.uniform(0.6, 1.1)), 1.1, 1.5)


def metal(rng: Rng, hue: Color, roughness: float, worn: float = 0.15) -> Material:
    """Return bare metal with smears; `hue` is its reflectance (linear)."""
    smear = textures.fractal(rng, 1.5)
    return Material(
        base_color=hue, metallic=1.0, roughness=1.0,
        orm_texture=textures.orm(np.clip(roughness + worn * (smear - 0.4), 0.03, 1.0)),
    )  # fmt: skip


def any_metal(rng: Rng, roughness: float) -> Material:
    """Return gold, copper, steel, brass or a blue metal."""
    kinds = ((1.0, 0.72, 0.3), (0.9, 0.55, 0.42), (0.62, 0.6, 0.58), (0.85, 0.75, 0.45), (0.4, 0.5, 0.7))
    return metal(rng, _any(rng, kinds), roughness)


def brushed(rng: Rng, hue: Color) -> Material:
    """Return turned metal: fine grooves that make highlights long."""
    grooves = np.tile(textures.fractal(rng, 0.4)[:1], (textures.SIZE, 1))
    made = metal(rng, hue, 0.22)
    return replace(made, normal_texture=textures.normals(grooves, 0.5))


def paint(rng: Rng, hue: Color | None = None, gloss: float = 0.6) -> Material:
    """Return painted metal with chips and dirt; `hue` is sRGB."""
    dirt, chips = textures.fractal(rng, 1.4), textures.fractal(rng, 0.9) > 0.78
    top = textures.color(rng, 0.75, 0.7) if hue is None else hue
    field = np.where(chips, 0.25, 0.75 + 0.35 * (dirt - 0.5))
    return _relief(
        shade(field, (0.04, 0.04, 0.04), _scaled(top, 1.3)), np.where(chips, 0.0, 1.0), 0.5,
        textures.orm(np.where(chips, 0.8, 0.75 - 0.6 * gloss + 0.2 * dirt), np.where(chips, 0.6, 0.0)),
    )  # fmt: skip


def plates(rng: Rng, hue: Color) -> Material:
    """Return sheet metal with seams and rivets; `hue` is sRGB."""
    seams, tone = textures.courses(rng, 2, 2, joint=0.03, shift=0.0)
    y, x = (np.mgrid[: textures.SIZE, : textures.SIZE] + 0.5) / textures.SIZE
    rim = np.minimum(np.abs(y % 0.5 - 0.04), np.abs(x % 0.5 - 0.04)) < 0.015
    rivets = rim * (np.hypot(x * 16 % 1.0 - 0.5, y * 16 % 1.0 - 0.5) < 0.3)
    rust = np.clip(textures.fractal(rng, 1.2) * 2.0 - 1.1, 0.0, 1.0)
    field = seams * (0.6 + 0.15 * tone + 0.3 * rivets) - 0.4 * rust
    return _relief(
        shade(field, (0.12, 0.07, 0.05), _scaled(hue, 1.3)), seams + rivets, 2.5,
        textures.orm(0.4 + 0.5 * rust, 0.85 * (1.0 - rust)),
    )  # fmt: skip


def striped(rng: Rng, count: int, hue: Color | None = None) -> Material:
    """Return striped cloth, visible from both sides; `hue` is sRGB."""
    weave = 0.12 * (textures.fractal(rng, 0.5) - 0.5)
    texture = shade(textures.stripes(count) + weave, hue or textures.color(rng, 0.8, 0.7), (0.92, 0.9, 0.85))
    return Material(base_color_texture=texture, roughness=0.9, specular=0.2, double_sided=True)


def cloth(rng: Rng, hue: Color | None = None) -> Material:
    """Return plain woven cloth; `hue` is sRGB."""
    y, x = np.mgrid[: textures.SIZE, : textures.SIZE]
    weave = 0.5 + 0.25 * np.sin(x * np.pi / 4.0) + 0.25 * np.sin(y * np.pi / 4.0)
    tone = hue or textures.color(rng, 0.6, 0.6)
    return replace(
        _relief(
            shade(0.7 * weave + 0.3 * textures.fractal(rng, 1.3), _scaled(tone, 0.6), _scaled(tone, 1.2)),
            weave, 1.0, textures.orm(np.full_like(weave, 0.95), 0.0),
        ),
        specular=0.2, double_sided=True,
    )  # fmt: skip


def fence(rng: Rng, meshes: int = 8) -> Material:
    """Return chain-link, `meshes` diamonds on one texture."""
    opacity = textures.chain_link(meshes, rng.uniform(0.12, 0.2))
    rust = textures.fractal(rng, 1.3)
    return _cut_out(shade(rust, (0.45, 0.42, 0.38), (0.85, 0.86, 0.88), opacity), 0.4, 0.7)


def grille(rng: Rng, across: int, down: int, width: float, hue: Color = (0.5, 0.5, 0.5)) -> Material:
    """Return crossing bars with holes between them."""
    opacity = textures.bars(across, down, width)
    return _cut_out(
        shade(textures.fractal(rng, 1.2), _scaled(hue, 0.6), _scaled(hue, 1.2), opacity), 0.45, 0.6
    )


def net(rng: Rng, cells: int, width: float, hue: Color = (0.9, 0.9, 0.88)) -> Material:
    """Return a cloth net of square meshes."""
    return replace(grille(rng, cells, cells, width, hue), metallic=0.0, roughness=0.9)


def foliage(rng: Rng, hue: Color, count: int = 7) -> Material:
    """Return leaves on a card; `hue` is sRGB."""
    opacity, tone = textures.leaves(rng, count, rng.uniform(1.6, 3.5))
    return _cut_out(shade(tone, _scaled(hue, 0.45), _scaled(hue, 1.35), opacity), 0.6, 0.0)


def grass(rng: Rng, hue: Color) -> Material:
    """Return blades of grass, dark at the root; `hue` is sRGB."""
    rows = np.linspace(1.0, 0.0, 64)[:, None] * np.ones((1, 64))
    tone = 0.75 * rows + 0.25 * textures.fractal(rng, 0.8, 64)
    texture = shade(tone, _scaled(hue, 0.3), _scaled(hue, 1.35))
    return Material(base_color_texture=texture, roughness=0.65, specular=0.3, double_sided=True)


def glow(color: Color, strength: float) -> Material:
    """Return an emissive material for tubes, bulbs and signs."""
    red, green, blue = (strength * channel for channel in color)
    return Material(base_color=(0.05, 0.05, 0.05), emissive=(red, green, blue))


def poster(rng: Rng, shine: float = 0.0) -> Material:
    """Return a printed image; `shine` makes it a lit screen."""
    image = textures.poster_image(rng)
    if shine:
        return Material(base_color=(0.02, 0.02, 0.02), emissive=(shine,) * 3, emissive_texture=image)
    return Material(base_color_texture=image, roughness=0.55)


def _relief(color: Texture, height: Values, strength: float, orm: Texture) -> Material:
    return Material(
        base_color_texture=color,
        normal_texture=textures.normals(height, strength),
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
