"""The ceiling of predictions for squares of 2x2 pixels."""

import numpy as np

from studies.class_ceiling import LEAST, counts_of
from supersampler_bench.quality.summaries import BORDER


def overlaps(inner: np.ndarray, number: int) -> list[float]:
    """Return the intersections over unions of a class, for each number of LEAST."""
    both, either = np.moveaxis(counts_of(np.pad(inner, BORDER))[number], 1, 0)
    return list(both / either)


def test_a_class_that_fills_squares_can_be_met_completely() -> None:
    truth = np.zeros((8, 12), np.uint8)
    truth[2:6, 4:8] = 1
    assert overlaps(truth, 1) == [1.0] * len(LEAST)
    assert overlaps(truth, 0) == [1.0] * len(LEAST)


def test_a_line_one_pixel_wide_is_half_of_its_squares() -> None:
    truth = np.zeros((8, 12), np.uint8)
    truth[4] = 2
    assert overlaps(truth, 2) == [0.5, 0.5, 0.0, 0.0]


def test_sizes_may_be_odd() -> None:
    truth = np.zeros((9, 11), np.uint8)
    truth[:, 0] = 1
    assert overlaps(truth, 1)[0] == 0.5
