"""Weights of static tiles: sums, first moments and bounds at any ratio and with any jitter sequence."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supersampler import halton_jitter
from supersampler.backends.cpu.static_weights import MOST, NONE, StaticWeights, static_axis
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Size

JITTER = st.floats(-0.5, 0.5)
SIDE = st.integers(3, 40)


def halton(ratio: float) -> list[tuple[float, float]]:
    return [halton_jitter(index, ratio) for index in range(jitter_phase_count(ratio))]


def moments(weights: StaticWeights, frames: int) -> tuple[np.ndarray, ...]:
    """(H, W) each: sum of weights, moments across and down, number of samples, least and largest weight."""
    each = np.stack([weights.of_frame(i).astype(np.float64) for i in range(frames)])
    x, y = weights.columns, weights.rows
    count = (y.sample != NONE).astype(float).T @ (x.sample != NONE)
    across, down = (each * x.offset[:, None]).sum(0), (each * y.offset[:, :, None]).sum(0)
    return each.sum(0), across, down, count, each.min(0), each.max(0)


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0, 4.0])
def test_first_moments_vanish_over_a_period_of_halton_jitter(ratio: float) -> None:
    display = (96, 72)
    weights = StaticWeights(display, (round(96 / ratio), round(72 / ratio)), halton(ratio))
    total, across, down, count, least, _ = moments(weights, jitter_phase_count(ratio))
    assert count.min() >= 7
    np.testing.assert_allclose(total, 1.0, atol=1e-6)
    assert max(np.abs(across).max(), np.abs(down).max()) < 1e-6
    assert least.min() >= 0.0


def test_plain_means_are_biased_at_ratio_2_by_what_the_weights_remove() -> None:
    weights = StaticWeights((96, 72), (48, 36), halton(2.0))
    x, y = weights.columns, weights.rows
    present = (y.sample != NONE)[:, :, None] & (x.sample != NONE)[:, None]
    bias = (present * x.offset[:, None]).sum(0) / present.sum(0)
    assert 0.05 < np.abs(bias).max() < 0.1


@settings(max_examples=60, deadline=None)
@given(
    display=st.tuples(SIDE, SIDE),
    ratio=st.floats(1.0, 4.0),
    jitter=st.lists(st.tuples(JITTER, JITTER), min_size=1, max_size=40),
)
def test_weights_of_any_sequence_sum_to_one_are_bounded_and_no_more_biased_than_equal_ones(
    display: Size, ratio: float, jitter: list[tuple[float, float]]
) -> None:
    render = (max(1, round(display[0] / ratio)), max(1, round(display[1] / ratio)))
    weights = StaticWeights(display, render, jitter)
    total, across, down, count, least, most = moments(weights, len(jitter))
    np.testing.assert_allclose(total, count > 0, atol=1e-5)
    assert least.min() >= -1e-6
    assert (most * np.maximum(count, 1)).max() <= MOST + 1e-3
    x, y = weights.columns, weights.rows
    present = (y.sample != NONE)[:, :, None] & (x.sample != NONE)[:, None]
    number = np.maximum(present.sum(0), 1)
    bias = [(present * o).sum(0) / number for o in (x.offset[:, None], y.offset[:, :, None])]
    assert (np.hypot(across, down) <= np.hypot(*bias) + 1e-5).all()


@settings(max_examples=60, deadline=None)
@given(display=SIDE, ratio=st.floats(1.0, 4.0), jitter=JITTER)
def test_each_sample_lies_in_the_pixel_that_its_offset_says(
    display: int, ratio: float, jitter: float
) -> None:
    render = max(1, round(display / ratio))
    axis = static_axis(display, render, [jitter])
    pixels = np.flatnonzero(axis.sample[0] != NONE)
    place = (axis.sample[0, pixels] + 0.5 + jitter) * display / render
    np.testing.assert_allclose(pixels + 0.5 + axis.offset[0, pixels], place, atol=1e-5)
    assert np.abs(axis.offset).max() <= 0.5
    assert len(pixels) == len(set(axis.sample[0, pixels]))


def test_zero_jitter_and_single_frames_give_equal_weights() -> None:
    weights = StaticWeights((8, 8), (4, 4), [(0.0, 0.0)] * 3)
    used = weights.of_frame(0)
    assert set(np.unique(used).tolist()) <= {0.0, float(np.float32(1.0 / 3.0))}
    np.testing.assert_array_equal(used, weights.of_frame(2))


def test_a_mean_is_exact_where_color_is_linear() -> None:
    ratio, display, render = 2.0, (32, 24), (16, 12)
    jitter = halton(ratio)
    weights, total = StaticWeights(display, render, jitter), np.zeros(display[::-1])
    for frame in range(len(jitter)):
        x, y = weights.columns, weights.rows
        place_x, place_y = np.arange(32) + 0.5 + x.offset[frame], np.arange(24) + 0.5 + y.offset[frame]
        total += weights.of_frame(frame) * (0.3 * place_x + 0.7 * place_y[:, None])
    exact = 0.3 * (np.arange(32) + 0.5) + 0.7 * (np.arange(24) + 0.5)[:, None]
    np.testing.assert_allclose(total, exact, atol=1e-5)
