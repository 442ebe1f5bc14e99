"""The methods draw the pictures in tests/golden, to within rounding."""

from pathlib import Path

import numpy as np
import pytest

from golden import METHODS, drawn, stored
from supersampler.io.images import write_png


@pytest.mark.parametrize("method", METHODS)
def test_a_method_draws_its_golden_picture(method: str, tmp_path: Path) -> None:
    picture = drawn(method)
    write_png(tmp_path / f"{method}.png", picture)
    off = np.abs(picture.astype(int) - stored(method))
    hint = f"drawn: {tmp_path}/{method}.png; if it is better, run python tests/golden.py"
    assert (off > 2).mean() < 0.001, hint
    assert off.mean() < 0.05, hint
