"""OpenGL contexts: which backend is opened, and the error message where none is available."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gl_scenes import Yard
from supersampler_model.data.errors import GraphicsError
from supersampler_model.data.renderer import context
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
    """In a process of its own, as two Mesas in one do not get on."""
    path = {"PYTHONPATH": os.pathsep.join([*sys.path, str(Path(__file__).parents[2])])}
    command = [sys.executable, "-c", WITHOUT_EGL, str(tmp_path / "color.npy")]
    subprocess.run(command, check=True, env={**os.environ, **path})
    other = np.load(tmp_path / "color.npy")
    mine = Renderer((160, 90), samples=4).reference(Yard().scene(2)).color
    assert np.quantile(np.abs(other - mine), 0.999) < 0.02
