"""Tests of examples/panda3d_live.py with Panda3D, OpenGL in software will do: `make panda3d` runs them."""

import importlib.util
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler.conventions import RawFrame, jittered_projection
from supersampler.validation import detect_conventions

SCRIPT = Path(__file__).parents[2] / "examples" / "panda3d_live.py"

if importlib.util.find_spec("panda3d") is None:
    pytest.skip("panda3d is not installed here", allow_module_level=True)


@pytest.fixture(scope="module")
def renderer() -> Any:
    """The renderer of the example; Panda3D allows one a process."""
    return runpy.run_path(str(SCRIPT))["Renderer"]((160, 90))


def test_the_film_offset_is_the_jitter_of_the_projection(renderer: Any) -> None:
    plain, jitter = renderer.view_projection(), (0.25, -0.375)
    renderer.shift(jitter)
    shifted = renderer.view_projection()
    renderer.shift((0.0, 0.0))
    np.testing.assert_allclose(shifted, jittered_projection(plain, jitter, renderer.size), atol=1e-5)
    assert np.abs(shifted - plain).max() > 1e-3


def test_motion_and_jitter_are_what_the_images_show(renderer: Any) -> None:
    frames = [renderer.frame(index) for index in range(4)]
    assert [frame.reset for frame in frames] == [True, False, False, False]
    assert np.abs(frames[1].motion).max() > 1.0
    raw = [
        RawFrame(
            color=frame.color, depth=frame.depth, motion=frame.motion, jitter=frame.jitter, reset=frame.reset
        )
        for frame in frames
    ]
    detection = detect_conventions(raw)
    assert detection.agrees, detection.summary()


def test_the_example_writes_its_images(tmp_path: Path) -> None:
    options = ["--frames", "2", "--display-size", "160x90", "-o", str(tmp_path)]
    done = subprocess.run([sys.executable, SCRIPT, *options], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert "upscaling" in done.stdout
    assert len(list(tmp_path.glob("*.png"))) == 2
