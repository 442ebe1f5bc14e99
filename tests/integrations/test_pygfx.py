"""Tests of examples/pygfx_live.py with pygfx; software Vulkan is enough: `make pygfx` runs them."""

import importlib.util
import sys
from pathlib import Path

import pytest

from commands import finished, ran
from supersampler.io.images import read_image

SCRIPT = Path(__file__).parents[2] / "examples" / "pygfx_live.py"

if importlib.util.find_spec("pygfx") is None:
    pytest.skip("pygfx is not installed here", allow_module_level=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--frames", 0], "--frames is 0; want at least 1\n"),
        (["--display-size", "241x136"], "is 241x136; want multiples of 2: 1 / 2 of it is rendered\n"),
    ],
)
def test_no_frames_and_odd_sizes_are_refused(tmp_path: Path, options: list[object], message: str) -> None:
    done = finished(sys.executable, SCRIPT, *options, "-o", tmp_path / "out")
    assert (done.returncode, done.stderr.endswith(message)) == (2, True), done.stderr
    assert not (tmp_path / "out").exists()


def test_an_unknown_model_is_refused_in_one_line(tmp_path: Path) -> None:
    done = finished(sys.executable, SCRIPT, "--frames", 1, "--model", "nope", "-o", tmp_path)
    assert (done.returncode, "\nno model 'nope'" in f"\n{done.stderr}") == (1, True), done.stderr
    assert "Traceback" not in done.stderr


def test_the_example_upscales_what_pygfx_has_rendered(tmp_path: Path) -> None:
    ran(sys.executable, SCRIPT, "--frames", 6, "--display-size", "320x180", "--model", "taau", "-o", tmp_path)
    assert len(list(tmp_path.glob("*.png"))) == 6
    both = 255.0 * read_image(tmp_path / "0005.png")["G"]
    render, image = both[:, :320], both[:, 320:]
    assert abs(render - image).mean() < 25.0, "of 255: the same view"
    assert image.std() > 10.0, "something is seen"
