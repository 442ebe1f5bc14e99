"""Every method renders its golden image in every backend that it has, to within rounding."""

from pathlib import Path

import numpy as np
import pytest

from golden import RUNS, Run, rendered, stored
from supersampler.io.images import write_png


@pytest.mark.parametrize("run", RUNS, ids=lambda run: f"{run.executor}-{run.path.stem}")
def test_a_method_renders_its_golden_image(run: Run, tmp_path: Path) -> None:
    image = rendered(run)
    write_png(tmp_path / run.path.name, image)
    off = np.abs(image.astype(int) - stored(run))
    hint = f"rendered: {tmp_path / run.path.name}; if it is better, run python tests/golden.py"
    assert (off > 2).mean() < 0.001, hint
    assert off.mean() < 0.05, hint
