"""Lettering and screens of procedural scenes."""

import numpy as np
import pytest

from supersampler_model.data.scenes.procedural.materials import lettering, screen, sign


@pytest.mark.parametrize("rows", [1, 3, 16])
def test_every_row_has_words_that_end_at_different_columns(rows: int) -> None:
    page = lettering(np.random.default_rng(1), rows, 256)
    assert page.shape == (256, 256)
    assert page.min() == 0.0
    assert page.max() == 1.0
    lines = np.split(page[: 256 // rows * rows], rows)
    ends = [int(np.flatnonzero(line.max(axis=0))[-1]) for line in lines]
    assert len(set(ends)) >= rows // 3
    assert all(0.02 < line[:, :end].mean() < 0.5 for line, end in zip(lines, ends, strict=True))


def test_words_have_gaps_between_them() -> None:
    line = lettering(np.random.default_rng(2), 8, 512)[:64]
    inked = line.max(axis=0) > 0.0
    gaps = np.diff(np.flatnonzero(inked))
    assert gaps.max() > 0.5 * 64 * 0.62  # a space is a glyph wide


def test_signs_reflect_and_screens_shine() -> None:
    rng = np.random.default_rng(3)
    board, lit, page = sign(rng, 4), sign(rng, 4, shine=2.0), screen(rng, 1.5)
    assert board.base_color_texture is not None
    assert max(board.emissive) == 0.0
    assert lit.emissive == (2.0,) * 3
    assert page.emissive_texture is not None
    assert page.emissive_texture.pixels.std() > 20.0  # not one colour
