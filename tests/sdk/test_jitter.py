"""Tests of jitter, mip bias and render sizes against FSR's code and XeSS's guide."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from supersampler import ArgumentError, FrameError
from supersampler.conventions.jitter import (
    RATIOS,
    check_ratio,
    halton_jitter,
    jitter_phase_count,
    jittered_projection,
    mip_bias,
    render_size_for,
)


@pytest.mark.parametrize(
    ("scale", "count"), [(1.0, 8), (1.3, 13), (1.5, 18), (1.7, 23), (2.0, 32), (2.3, 42), (3.0, 72)]
)
def test_phase_count_truncates_as_the_code_of_fsr_does(scale: float, count: int) -> None:
    assert jitter_phase_count(scale) == count


def test_jitter_is_halton_2_3_from_index_1() -> None:
    expected = [(0.0, -1 / 6), (-0.25, 1 / 6), (0.25, -7 / 18), (-0.375, -1 / 18)]
    np.testing.assert_allclose([halton_jitter(i, 2.0) for i in range(4)], expected, atol=1e-12)


def test_jitter_repeats_stays_in_the_pixel_is_never_zero_and_fills_it() -> None:
    jitter = np.array([halton_jitter(i, 2.0) for i in range(32)])
    assert halton_jitter(32, 2.0) == halton_jitter(0, 2.0)
    assert np.abs(jitter).max() <= 0.5
    assert np.abs(jitter).max(axis=1).min() > 0.0
    np.testing.assert_allclose(jitter.mean(axis=0), 0.0, atol=0.02)


@pytest.mark.parametrize(("scale", "fsr", "log2"), [
    (1.5, -1.585, -0.585), (1.7, -1.766, -0.766), (2.0, -2.0, -1.0), (2.3, -2.202, -1.202),
    (3.0, -2.585, -1.585),
])  # fmt: skip
def test_mip_bias_of_both_vendors(scale: float, fsr: float, log2: float) -> None:
    assert mip_bias(scale) == pytest.approx(fsr, abs=5e-4)
    assert mip_bias(scale, style="log2") == pytest.approx(log2, abs=5e-4)


def test_render_sizes_by_name_truncate_as_fsr_does() -> None:
    modes = "fsr_quality", "fsr_balanced", "xess_performance", 2.0
    sizes = [render_size_for((1920, 1080), mode) for mode in modes]
    assert sizes == [(1280, 720), (1129, 635), (834, 469), (960, 540)]
    assert render_size_for((2197, 1), 1.3) == (1690, 1)


def test_the_ratios_are_frozen() -> None:
    fsr = {name: ratio for name, ratio in RATIOS.items() if name.startswith("fsr_")}
    assert list(fsr.values()) == [1.0, 1.5, 1.7, 2.0, 3.0]
    assert list(RATIOS.values())[len(fsr) :] == [1.0, 1.3, 1.5, 1.7, 2.0, 2.3, 3.0]


def _perspective(depth: tuple[float, float], w_sign: float) -> NDArray[np.float64]:
    a, b = depth
    return np.array([[1.2, 0, 0.1, 0], [0, 2.1, -0.2, 0], [0, 0, a, b], [0, 0, w_sign, 0]])


PROJECTIONS = {
    "reversed infinite, right-handed": _perspective((0.0, 0.1), -1.0),
    "forward, right-handed": _perspective((-1.01, -0.2), -1.0),
    "forward, left-handed": _perspective((1.01, -0.1), 1.0),
    "orthographic": np.diag([0.4, 0.7, -0.01, 1.0]),
}


def _pixel(projection: NDArray[Any], point: NDArray[np.float64], size: tuple[int, int]) -> list[float]:
    """Return where a view-space point lands: pixels, y down; 0.5 is the centre of the first pixel."""
    x, y, _, w = projection @ point
    return [(x / w * 0.5 + 0.5) * size[0], (0.5 - y / w * 0.5) * size[1]]


@pytest.mark.parametrize("name", PROJECTIONS)
def test_the_image_moves_by_minus_jitter_under_any_projection(name: str) -> None:
    projection, size, jitter = PROJECTIONS[name], (321, 180), (0.25, -0.375)
    z = 4.0 if "left" in name else -4.0
    point = np.array([0.3, -0.7, z, 1.0])
    still = _pixel(projection, point, size)
    moved = _pixel(jittered_projection(projection, jitter, size), point, size)
    np.testing.assert_allclose(moved, [still[0] - 0.25, still[1] + 0.375], atol=1e-9)


def test_depth_is_left_alone_and_the_type_is_kept() -> None:
    projection = PROJECTIONS["forward, right-handed"].astype(np.float32)
    jittered = jittered_projection(projection, (0.5, -0.5), (4, 4))
    assert jittered.dtype == np.float32
    np.testing.assert_array_equal(jittered[2:], projection[2:])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: jitter_phase_count(0.0), r"scale is 0\.0; want display size / render size"),
        (lambda: mip_bias(float("nan")), "scale is nan"),
        (lambda: halton_jitter(-1, 2.0), "index is -1; want a frame number >= 0"),
        (lambda: render_size_for((1920, 1080), 0.5), r"mode is 0.5; .* 2.0 is half size"),
        (
            lambda: jittered_projection(np.eye(3), (0.0, 0.0), (4, 4)),
            r"matrix is of shape \(3, 3\); want a 4 x",
        ),
        (lambda: jittered_projection(np.eye(4), (float("inf"), 0.0), (4, 4)), "jitter is"),
    ],
)
def test_wrong_arguments_are_named(call: Callable[[], object], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        call()


# --- ratios of display to render size, with the rounding of sizes ---


LOW, HIGH = 1.0, 3.0
SIDES = st.integers(1, 5000)
RATIO_FLOATS = st.floats(LOW, HIGH)


def is_allowed(render: tuple[int, int], display: tuple[int, int], low: float = LOW) -> bool:
    try:
        check_ratio((low, HIGH), render, display)
    except FrameError:
        return False
    return True


@given(SIDES, SIDES, RATIO_FLOATS, st.sampled_from((math.floor, round, math.ceil)))
def test_rounded_sizes_are_allowed(width: int, height: int, ratio: float, to: Callable[[float], int]) -> None:
    render = max(1, to(width / ratio)), max(1, to(height / ratio))
    assert is_allowed(render, (width, height))
    assert is_allowed((width, height), (max(1, to(width * ratio)), max(1, to(height * ratio))))


@given(st.tuples(SIDES, SIDES), st.tuples(SIDES, SIDES), st.sampled_from((1.0, 1.5, 2.0)))
def test_allowed_sizes_are_within_a_pixel(
    render: tuple[int, int], display: tuple[int, int], low: float
) -> None:
    if is_allowed(render, display, low):
        for small, large in zip(render, display, strict=True):
            assert large - 1 <= HIGH * (small + 1)
            assert large + 1 >= low * (small - 1)


@given(SIDES)
def test_no_frame_is_larger_than_the_display(side: int) -> None:
    assert is_allowed((side, side), (side, side))
    assert not is_allowed((side + 1, side), (side, side))
    assert not is_allowed((side, side + 1), (side, side))
