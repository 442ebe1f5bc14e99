"""Textures of lettering and of user interfaces."""

import numpy as np

from supersampler_model.data.scenes.procedural import textures
from supersampler_model.data.scenes.scene import Material, Texture
from supersampler_model.data.values import Color, Rng, Values

SIZE = 512
GLYPHS = 16  # of an alphabet
_POINTS = tuple((x, y) for y in (0.12, 0.45, 0.78) for x in (0.12, 0.44, 0.76))
_STROKES = ((0, 2), (0, 6), (2, 8), (6, 8), (3, 5), (1, 7), (0, 8), (2, 6), (0, 4), (4, 8), (3, 6), (5, 8))
"""A glyph is some of these lines between two of _POINTS, (x, y) in its cell, [0, 1]."""


def lettering(rng: Rng, rows: int, size: int = SIZE) -> Values:
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
        share = np.clip(along, 0.0, 1.0)
        away = np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay))
        ink = np.maximum(ink, np.clip(0.5 + (0.08 - away) * height, 0.0, 1.0))
    return ink


def sign(rng: Rng, rows: int, shine: float = 0.0) -> Material:
    """Return a board with `rows` lines of lettering; `shine` > 0 is the radiance of a lit one."""
    ink = textures.color(rng, 0.7, 0.25)
    paper = (0.95, 0.94, 0.9) if rng.random() < 0.5 else textures.color(rng, 0.8, 0.9)
    dark, bright = (paper, ink) if rng.random() < 0.6 else (ink, paper)
    return _printed(textures.shade(lettering(rng, rows), dark, bright), shine)


def screen(rng: Rng, shine: float) -> Material:
    """Return a screen of radiance `shine` with a header and cards of text, charts and tables."""
    dark = rng.random() < 0.6
    ground, card = ((0.09, 0.1, 0.12), (0.17, 0.18, 0.22)) if dark else ((0.9, 0.91, 0.93), (1.0, 1.0, 1.0))
    ink: Color = (0.88, 0.9, 0.93) if dark else (0.12, 0.13, 0.16)
    page = np.empty((SIZE, SIZE, 3))
    page[:] = ground
    page[: SIZE // 12] = textures.color(rng, 0.8, 0.8)
    columns, gap = int(rng.integers(2, 4)), SIZE // 64
    width, top, height = SIZE // columns, SIZE // 12 + gap, SIZE // 3
    while top + height // 2 < SIZE:
        for column in range(columns):
            rows = slice(top, min(top + height, SIZE) - gap)
            _draw_card(rng, page[rows, column * width + gap : (column + 1) * width - gap], card, ink)
        top, height = top + height, int(rng.integers(SIZE // 6, SIZE // 2))
    return _printed(Texture(pixels=(255.0 * np.clip(page, 0.0, 1.0) + 0.5).astype(np.uint8)), shine)


def _draw_card(rng: Rng, part: Values, card: Color, ink: Color) -> None:
    """Draw a card in place: a paragraph, a chart of bars, a curve, or a table with lines of one pixel."""
    (height, width), accent = part.shape[:2], textures.color(rng, 0.9, 0.9)
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
