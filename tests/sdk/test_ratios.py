"""Ratios of display to render size: all that rounding makes of a ratio is allowed, and nothing else."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from supersampler import Frame, FrameError, Upscaler
from supersampler.conventions.jitter import check_ratio

LOW, HIGH = 1.0, 3.0
SIDES = st.integers(1, 5000)
RATIOS = st.floats(LOW, HIGH)


def is_allowed(render: tuple[int, int], display: tuple[int, int], low: float = LOW) -> bool:
    try:
        check_ratio((low, HIGH), render, display)
    except FrameError:
        return False
    return True


@given(SIDES, SIDES, RATIOS, st.sampled_from((math.floor, round, math.ceil)))
def test_sizes_that_are_rounded_either_way_are_allowed(
    width: int, height: int, ratio: float, to: Callable[[float], int]
) -> None:
    render = max(1, to(width / ratio)), max(1, to(height / ratio))
    assert is_allowed(render, (width, height))
    assert is_allowed((width, height), (max(1, to(width * ratio)), max(1, to(height * ratio))))


@given(st.tuples(SIDES, SIDES), st.tuples(SIDES, SIDES), st.sampled_from((1.0, 1.5, 2.0)))
def test_sizes_that_are_allowed_are_within_a_pixel_of_a_ratio(
    render: tuple[int, int], display: tuple[int, int], low: float
) -> None:
    if is_allowed(render, display, low):
        for small, large in zip(render, display, strict=True):
            assert large - 1 <= HIGH * (small + 1)
            assert large + 1 >= low * (small - 1)


@pytest.mark.parametrize("side", [16, 100, 1024, 8192])
def test_a_frame_of_one_pixel_does_not_become_a_large_image(side: int) -> None:
    assert not is_allowed((1, 1), (side, side))
    with pytest.raises(FrameError, match="want a ratio from 1"):
        Upscaler("taau", display_size=(side, side)).step(one_pixel())


def one_pixel() -> Frame:
    return Frame(
        color=np.ones((1, 1, 3), np.float32),
        depth=np.ones((1, 1), np.float32),
        motion=np.zeros((1, 1, 2), np.float32),
        jitter=(0.0, 0.0),
        reset=True,
    )
