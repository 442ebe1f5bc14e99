"""Weights of static tiles: sums, first moments and bounds at any ratio and with any jitter sequence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supersampler import halton_jitter
from supersampler.backends.cpu.static_weights import (
    INSIDE,
    NONE,
    REACH,
    StaticWeights,
    solve_weights,
    static_axis,
)
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Size

JITTER = st.floats(-0.5, 0.5)
SIDE = st.integers(3, 40)


def halton(ratio: float) -> list[tuple[float, float]]:
    return [halton_jitter(index, ratio) for index in range(jitter_phase_count(ratio))]


def present(weights: StaticWeights) -> np.ndarray:
    there: np.ndarray = (weights.rows.sample != NONE)[:, :, None] & (weights.columns.sample != NONE)[:, None]
    return there


def moments(weights: StaticWeights) -> tuple[np.ndarray, ...]:
    """(H, W) each: sum of weights, moments across and down, least weight."""
    each = np.stack([weights.of_frame(i).astype(np.float64) for i in range(weights.frames)])
    x, y = weights.columns, weights.rows
    across, down = (each * x.offset[:, None]).sum(0), (each * y.offset[:, :, None]).sum(0)
    return each.sum(0), across, down, each.min(0)


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0, 4.0])
def test_first_moments_vanish_over_a_period_of_halton_jitter(ratio: float) -> None:
    weights = StaticWeights((96, 72), (round(96 / ratio), round(72 / ratio)), halton(ratio))
    total, across, down, least = moments(weights)
    inner = slice(1, -1), slice(1, -1)
    assert present(weights).sum(0)[inner].min() >= 8
    np.testing.assert_allclose(total, 1.0, atol=1e-5)
    assert max(np.abs(across[inner]).max(), np.abs(down[inner]).max()) < 1e-3
    assert max(np.abs(across).max(), np.abs(down).max()) < 0.1  # there are no samples beyond the border
    assert least.min() >= 0.0


def test_plain_means_are_biased_at_ratio_2_by_what_the_weights_remove() -> None:
    weights = StaticWeights((96, 72), (48, 36), halton(2.0), reach=INSIDE)
    there = present(weights)
    bias = (there * weights.columns.offset[:, None]).sum(0) / there.sum(0)
    assert 0.05 < np.abs(bias).max() < 0.1


def test_an_edge_is_estimated_better_than_by_a_plain_mean_of_the_samples_in_each_pixel() -> None:
    """Every edge through a pixel, averaged: its mean is the fraction of the pixel on one side."""
    errors = {}
    for reach in (REACH, INSIDE):
        weights = StaticWeights((16, 16), (8, 8), halton(2.0), reach=reach)
        used = np.stack([weights.of_frame(i) for i in range(weights.frames)])
        plain = present(weights) / np.maximum(present(weights).sum(0), 1)
        squares = []
        for angle, start in [(a, s) for a in np.linspace(0.0, 3.0, 7) for s in np.linspace(-0.6, 0.6, 7)]:
            cos, sin = np.cos(angle), np.sin(angle)
            grid = (np.arange(32) + 0.5) / 32 - 0.5
            truth = (cos * grid + sin * grid[:, None] > start).mean()
            color = cos * weights.columns.offset[:, None] + sin * weights.rows.offset[:, :, None] > start
            squares.append([((w * color).sum(0)[4:12, 4:12] - truth) ** 2 for w in (used, plain)])
        errors[reach] = np.sqrt(np.mean(squares, axis=(0, 2, 3)))
    assert errors[REACH][0] < 0.85 * errors[INSIDE][1]
    assert errors[REACH][0] < errors[INSIDE][0]


@settings(max_examples=40, deadline=None)
@given(
    display=st.tuples(SIDE, SIDE),
    ratio=st.floats(1.0, 4.0),
    jitter=st.lists(st.tuples(JITTER, JITTER), min_size=1, max_size=40),
)
def test_weights_of_any_sequence_are_a_mean(
    display: Size, ratio: float, jitter: list[tuple[float, float]]
) -> None:
    render = (max(1, round(display[0] / ratio)), max(1, round(display[1] / ratio)))
    weights = StaticWeights(display, render, jitter)
    total, *_, least = moments(weights)  # the sum is less where pixels that share weights lack a sample
    assert total.max() <= 1.0 + 1e-5
    assert (total[~present(weights).any(0)] == 0.0).all()
    assert least.min() >= 0.0


@settings(max_examples=60, deadline=None)
@given(display=SIDE, ratio=st.floats(1.0, 4.0), jitter=JITTER)
def test_each_sample_lies_where_its_offset_says_and_near_its_pixel(
    display: int, ratio: float, jitter: float
) -> None:
    render = max(1, round(display / ratio))
    axis = static_axis(display, render, [jitter])
    pixels = np.flatnonzero(axis.sample[0] != NONE)
    place = (axis.sample[0, pixels] + 0.5 + jitter) * display / render
    np.testing.assert_allclose(pixels + 0.5 + axis.offset[0, pixels], place, atol=1e-5)
    assert np.abs(axis.offset).max() <= REACH
    inside = static_axis(display, render, [jitter], INSIDE)
    found = inside.sample[0][inside.sample[0] != NONE]
    assert len(found) == len(set(found))


def test_zero_jitter_and_single_frames_give_equal_weights() -> None:
    weights = StaticWeights((8, 8), (4, 4), [(0.0, 0.0)] * 3)
    for frame in range(3):
        np.testing.assert_allclose(weights.of_frame(frame), 1.0 / 3.0, rtol=1e-5)
    np.testing.assert_array_equal(StaticWeights((8, 8), (8, 8), [(0.2, -0.3)]).of_frame(0), 1.0)


def test_samples_on_a_line_or_on_one_side_still_give_a_mean() -> None:
    line = np.stack([np.linspace(-0.5, 0.5, 5), np.zeros(5)], axis=-1)
    aside = np.stack([np.linspace(0.2, 0.7, 5), np.linspace(0.1, 0.6, 5) ** 2], axis=-1)
    none = np.zeros((5, 2))
    there = np.array([[True] * 5, [True] * 5, [False] * 5])
    found = solve_weights(np.stack([line, aside, none]), there)
    np.testing.assert_allclose(found.sum(1), [1.0, 1.0, 0.0], atol=1e-9)
    assert found.min() >= 0.0
    np.testing.assert_allclose(found[0] @ line, 0.0, atol=1e-3)


@pytest.mark.parametrize(
    ("display", "render", "error"), [((32, 24), (16, 12), 1e-3), ((203, 127), (97, 61), 0.12)]
)
def test_a_mean_is_exact_where_color_is_linear_and_nearly_at_ratios_without_equal_places(
    display: Size, render: Size, error: float
) -> None:
    jitter = halton(2.0)
    weights = StaticWeights(display, render, jitter)
    total, mass = np.zeros((2, *display[::-1]))
    x, y = weights.columns, weights.rows
    for frame in range(len(jitter)):
        used = weights.of_frame(frame)
        total += used * (x.offset[frame] + y.offset[frame][:, None])
        mass += used
    assert mass[2:-2, 2:-2].min() > 0.8
    assert np.abs(total / mass)[2:-2, 2:-2].max() < error
