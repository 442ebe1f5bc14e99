"""Tests of the display transform and of measured exposure, with invalid pixels, too."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from supersampler.conventions.encodings import srgb_encoded
from supersampler.io.display import ExposureMeter, auto_exposure, display_transform, to_uint8

HOSTILE = np.array(
    [[[np.nan, np.inf, -np.inf], [-1.0, 65504.0, 1e-45]], [[0.0, 0.0, 0.0], [1e38, 1.0, 0.5]]], np.float32
)


def grey(value: float) -> np.ndarray:
    return np.full((2, 3, 3), value, np.float32)


@pytest.mark.parametrize(("linear", "encoded"), [(0.0, 0.0), (0.001, 0.01292), (0.5, 0.735357), (1.0, 1.0)])
def test_srgb_is_the_standard_one(linear: float, encoded: float) -> None:
    assert srgb_encoded(grey(linear))[0, 0, 0] == pytest.approx(encoded, abs=1e-5)


def test_the_curve_divides_by_one_plus_the_largest_channel() -> None:
    color = np.array([[[3.0, 1.0, 0.5]]], np.float32)
    expected = srgb_encoded(color * 2.0 / (1.0 + 6.0))
    np.testing.assert_allclose(display_transform(color, 2.0), expected, rtol=1e-6)


def test_hostile_pixels_stay_inside_the_range() -> None:
    shown = display_transform(HOSTILE, 3.0)
    assert shown.dtype == np.float32
    assert np.isfinite(shown).all()
    assert shown.min() >= 0.0
    assert shown.max() <= 1.0


@given(hnp.arrays(np.float32, (1, 2, 3), elements=st.floats(0, 1024, width=32)), st.floats(0.01, 100))
def test_more_light_is_never_darker_in_its_largest_channel(color: np.ndarray, gain: float) -> None:
    less, more = display_transform(color, gain), display_transform(color, gain * 2)
    assert (more.max(axis=-1) >= less.max(axis=-1) - 1e-6).all()


def test_half_precision_gives_the_same_image() -> None:
    half = np.linspace(0, 8, 30).reshape(2, 5, 3).astype(np.float16)
    np.testing.assert_array_equal(display_transform(half), display_transform(half.astype(np.float32)))


def test_bytes_are_rounded_not_cut_off() -> None:
    assert to_uint8(np.array([-1.0, 0.0, 0.499 / 255, 0.501 / 255, 1.0, 2.0])).tolist() == [
        0,
        0,
        0,
        1,
        255,
        255,
    ]


def test_the_log_average_of_a_grey_image_comes_to_middle_grey() -> None:
    assert auto_exposure(grey(0.5)) == pytest.approx(0.36, rel=1e-5)


def test_black_pixels_count_as_the_darkest_too_bright_ones_as_65504_and_nan_not_at_all() -> None:
    assert auto_exposure(grey(0.0)) == auto_exposure(grey(-1.0)) == pytest.approx(1800.0, rel=1e-4)
    assert auto_exposure(grey(np.nan)) == pytest.approx(1800.0)
    assert auto_exposure(grey(np.inf)) == auto_exposure(grey(1e30)) == pytest.approx(0.18 / 65504.0)
    half_broken = np.concatenate([grey(0.5), grey(np.nan)])
    assert auto_exposure(half_broken) == pytest.approx(0.36, rel=1e-5)


def test_the_meter_takes_the_engines_exposure_as_it_is() -> None:
    assert ExposureMeter().read(grey(1.0), given=2.5) == 2.5


def test_a_measured_exposure_is_of_colour_without_pre_exposure() -> None:
    assert ExposureMeter().read(grey(0.72), pre_exposure=4.0) == pytest.approx(1.0)
    assert ExposureMeter().read(grey(0.72), given=2.5, pre_exposure=4.0) == 2.5


def test_the_meter_follows_slowly_until_a_cut() -> None:
    meter = ExposureMeter()
    assert meter.read(grey(0.18)) == pytest.approx(1.0)
    assert meter.read(grey(1.8)) == pytest.approx(0.1**0.1)
    assert meter.read(None) == pytest.approx(0.1**0.1)  # a frame that was not shaded
    assert meter.read(grey(1.8), reset=True) == pytest.approx(0.1)
