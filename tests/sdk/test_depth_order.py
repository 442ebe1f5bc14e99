"""Tests of `bend`, the curvature of depth by which the detector tells its kind."""

import numpy as np
import pytest

from supersampler.frame import Float32
from supersampler.validation.depth_order import bend


def plane(height: int, width: int, slope: float = 1e-4) -> Float32:
    """1 / distance of a plane, float32."""
    rows, columns = np.mgrid[:height, :width]
    return np.asarray(0.1 + slope * (columns + 0.5 * rows), np.float32)


@pytest.mark.parametrize(("height", "width"), [(300, 1300), (1300, 300), (60, 80)])
def test_a_plane_in_the_middle_has_no_bend_whatever_is_around_it(height: int, width: int) -> None:
    depth = plane(height, width)
    far_off = np.ones_like(depth, dtype=bool)
    far_off[max(0, height // 2 - 200) : height // 2 + 200, max(0, width // 2 - 200) : width // 2 + 200] = (
        False
    )
    depth[far_off] = np.random.default_rng(0).random(far_off.sum(), np.float32)
    assert bend(depth, "reversed") == 0.0


def test_rounding_of_forward_depth_is_that_of_numbers_near_1() -> None:
    rows, columns = np.mgrid[:200, :300]
    inverse = 1e-3 + 2e-5 * columns + 2e-5 * rows
    assert bend((1.0 - inverse).astype(np.float32), "forward") == 0.0


def test_depth_that_is_read_in_the_wrong_order_is_bent() -> None:
    linear = 1.0 / plane(200, 300, 1e-3)
    assert bend(linear, "linear") == 0.0
    assert bend(linear, "reversed") > 1e-3
