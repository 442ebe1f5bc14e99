"""Where rows and columns look, as kernels can read it: sixteen pixels at once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.resample_tables import Axis, Filter, catmull_rom

jitters = st.floats(-0.5, 0.5) | st.sampled_from([0.0, 1e-7, -1e-7, 0.4999999, 0.5, -0.5])


@given(st.integers(1, 9000), st.floats(1.0, 4.0), jitters)
def test_eight_pixels_look_at_eight_samples_and_the_next_eight_not_far_from_there(
    render: int, ratio: float, jitter: float
) -> None:
    display = round(render * ratio)
    axis = Axis(display, render, [], [], jitter)
    for table in (axis.start, axis.near):
        whole = table[: display // LANES * LANES].reshape(-1, LANES)
        for eight in (whole[:, :8], whole[:, 8:]):
            apart = eight - eight[:, :1]
            assert apart.min(initial=0) >= 0
            assert apart.max(initial=0) < 8
        assert (whole[:, 8] - whole[:, 0]).max(initial=0) <= 8


@pytest.mark.parametrize("size", [960, 3840, 8192])
def test_a_pixel_on_a_sample_takes_it_however_it_is_rounded(size: int) -> None:
    axis = Axis(size, size, [Filter(catmull_rom, scaled=False)], [], 1e-7)
    (weights,) = axis.weights
    samples = axis.start[:size, None] + np.arange(-1, 3)
    taken = np.where(samples == np.arange(size)[:, None], weights, 0.0).sum(axis=1)
    np.testing.assert_allclose(taken, 1.0, atol=2e-3)
