"""The amplitude of the jitter in images is estimated from reprojection, and reported where it is clear."""

import pytest

from supersampler.validation.temporal import FACTORS, wrong_amplitude

VARIANCE = 1.0


def errors(x: float, y: float, gain: float) -> dict[tuple[float, float], tuple[float, ...]]:
    """Errors whose least one is at these factors, and lower by `gain` than that of the stated jitter."""
    stated, least = 0.1, 0.1 * (1.0 - gain)
    slope = (stated - least) / ((1.0 - x) ** 2 + (1.0 - y) ** 2)
    return {(a, b): (least + slope * ((a - x) ** 2 + (b - y) ** 2), VARIANCE) for a, b in FACTORS}


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.5), (1.5, 1.5), (0.5, 1.5)])
def test_a_jitter_that_is_wrong_in_both_axes_is_found_by_a_small_gain(x: float, y: float) -> None:
    found = wrong_amplitude(errors(x, y, 0.2), 2)
    assert found is not None
    assert (found.x, found.y) == pytest.approx((x, y), abs=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_jitter_that_is_wrong_in_one_axis_takes_a_larger_gain(axis: int) -> None:
    x, y = ((0.5, 1.0), (1.0, 0.5))[axis]
    assert wrong_amplitude(errors(x, y, 0.06), 2) is None
    assert wrong_amplitude(errors(x, y, 0.12), 2) is not None


def test_one_pair_of_frames_and_a_right_jitter_say_nothing() -> None:
    assert wrong_amplitude(errors(0.5, 0.5, 0.2), 1) is None
    assert wrong_amplitude(errors(0.9, 1.1, 0.2), 2) is None
