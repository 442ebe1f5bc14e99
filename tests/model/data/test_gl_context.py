"""OpenGL contexts: which backend is opened, and the error message where none is available."""

import importlib.util
import re
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from gl_scenes import Yard
from supersampler_model.data.errors import GraphicsError
from supersampler_model.data.renderer import context
from supersampler_model.data.renderer.context import Graphics
from supersampler_model.data.renderer.renderer import Renderer

FOUND = importlib.util.find_spec
APT = "apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri"
PIP = "pip install lavavu-osmesa"

WITHOUT_EGL = """
import sys
import numpy as np
from gl_scenes import Yard
from supersampler_model.data.renderer import context
from supersampler_model.data.renderer.renderer import Renderer

context.find_library = lambda _: None
graphics = context.open_graphics()
np.save(sys.argv[1], Renderer((160, 90), samples=4, graphics=graphics).reference(Yard().scene(2)).color)
"""

WITHOUT_OPENGL = """
import sys
import pytest
from supersampler_model.data.renderer import context

def missing():
    raise Exception("hidden")

context._open_egl = context._open_osmesa = missing
sys.exit(pytest.main(["-q", "--tb=line", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


def python(script: str, *arguments: str | Path) -> "subprocess.CompletedProcess[str]":
    """Run a script in a process of its own, as two Mesas in one do not get on."""
    path = [*sys.path, str(Path(__file__).parents[2])]
    command = [sys.executable, "-c", f"import sys; sys.path[:0] = {path!r}\n{script}", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


class FakeGraphics(Graphics):
    """A context that does nothing."""

    def call(self, name: str, *arguments: int | None) -> None: ...


def opener(name: str, tried: list[str], problem: str | None) -> Callable[[], Graphics]:
    """Return a way to open a context that fails where there is a problem, as moderngl does."""

    def open_() -> Graphics:
        tried.append(name)
        if problem is not None:
            raise Exception(problem)
        return FakeGraphics(nullcontext(name), lambda _: None)

    return open_


@pytest.mark.parametrize(
    ("problem", "tried"),
    [(None, ["egl"]), ("requested device index 0, but found 0 devices", ["egl", "osmesa"])],
)
def test_egl_comes_first_and_osmesa_where_it_does_not_work(
    problem: str | None, tried: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[str] = []
    monkeypatch.setattr(context, "_open_egl", opener("egl", seen, problem))
    monkeypatch.setattr(context, "_open_osmesa", opener("osmesa", seen, None))
    assert context.open_graphics().gl.enter_result == tried[-1]
    assert seen == tried


def test_without_opengl_one_line_says_why_and_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(context, "find_library", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "lavavu" else FOUND(name))
    with pytest.raises(GraphicsError) as caught:
        context.open_graphics()
    reasons = "egl: libEGL is not installed; osmesa: the wheel lavavu-osmesa is not installed"
    assert str(caught.value) == f"no OpenGL 4.5 ({reasons}). Do one of: {APT}; {PIP}"


def test_without_moderngl_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "moderngl" else FOUND(name))
    with pytest.raises(GraphicsError, match=r'pip install "supersampler\[render\]"'):
        context.open_graphics()


def test_where_libegl_is_not_installed_osmesa_renders_the_same_image(tmp_path: Path) -> None:
    done = python(WITHOUT_EGL, tmp_path / "color.npy")
    assert done.returncode == 0, done.stderr
    other = np.load(tmp_path / "color.npy")
    mine = Renderer((160, 90), samples=4).reference(Yard().scene(2)).color
    assert np.quantile(np.abs(other - mine), 0.999) < 0.02


@pytest.mark.long  # runs tests in a process
def test_without_opengl_the_tests_that_draw_fail_by_the_line_that_mends_it_and_none_is_skipped() -> None:
    folder = Path(__file__).parent
    files = [folder / name for name in ("test_gl_motion.py", "test_gl_renderer.py")]
    done = python(WITHOUT_OPENGL, "--rootdir", Path(__file__).parents[3], *files)
    assert done.returncode == pytest.ExitCode.TESTS_FAILED, done.stdout + done.stderr
    summary = done.stdout.strip().splitlines()[-1]  # "2 passed, 30 errors in 1.2s"
    counts = {kind: int(number) for number, kind in re.findall(r"(\d+) (\w+)", summary.partition(" in ")[0])}
    assert set(counts) <= {"passed", "failed", "error", "errors"}, summary
    assert done.stdout.count(f"Do one of: {APT}; {PIP}") >= sum(counts.values()) - counts.get("passed", 0)
