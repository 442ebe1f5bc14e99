"""Tests of examples/pygfx_live.py with pygfx; software Vulkan is enough: `make pygfx` runs them."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from supersampler.io.images import read_image

SCRIPT = Path(__file__).parents[2] / "examples" / "pygfx_live.py"

if importlib.util.find_spec("pygfx") is None:
    pytest.skip("pygfx is not installed here", allow_module_level=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", "0"], "--frames is 0; want at least 1\n"),
        (
            ["--display-size", "241x136"],
            "--display-size is 241x136; want multiples of 2: 1 / 2 of it is rendered\n",
        ),
    ],
)
def test_no_frames_and_odd_sizes_are_refused(tmp_path: Path, options: list[str], message: str) -> None:
    command = [sys.executable, str(SCRIPT), *options, "-o", str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr.endswith(message)) == (2, True), done.stderr
    assert not (tmp_path / "out").exists()


def test_the_example_upscales_what_pygfx_has_rendered(tmp_path: Path) -> None:
    options = ["--frames", "6", "--display-size", "320x180", "--model", "taau", "-o", str(tmp_path)]
    done = subprocess.run([sys.executable, SCRIPT, *options], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("*.png"))) == 6
    both = 255.0 * read_image(tmp_path / "0005.png")["G"]
    render, image = both[:, :320], both[:, 320:]
    assert abs(render - image).mean() < 25.0, "of 255: the same view"
    assert image.std() > 10.0, "something is seen"
