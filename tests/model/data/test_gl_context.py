"""Where OpenGL comes from, and what is said where it is missing."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gl_scenes import Yard
from supersampler_model.data.errors import GraphicsError
from supersampler_model.data.gl import context
from supersampler_model.data.gl.renderer import Renderer

FOUND = importlib.util.find_spec

WITH_OSMESA = """
import sys
import numpy as np
from gl_scenes import Yard
from supersampler_model.data.gl.context import open_graphics
from supersampler_model.data.gl.renderer import Renderer

renderer = Renderer((160, 90), samples=4, graphics=open_graphics("osmesa"))
np.save(sys.argv[1], renderer.reference(Yard().scene(2)).color)
"""


def test_without_opengl_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(context, "find_library", lambda _: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "lavavu" else FOUND(name))
    with pytest.raises(GraphicsError) as caught:
        context.open_graphics()
    message = str(caught.value)
    assert "\n" not in message
    for line in ("apt-get install libegl1 libgl1 libegl-mesa0 libgl1-mesa-dri", "pip install lavavu-osmesa"):
        assert line in message


def test_without_moderngl_the_message_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "moderngl" else FOUND(name))
    with pytest.raises(GraphicsError, match=r'pip install "supersampler\[render\]"'):
        context.open_graphics()


def test_osmesa_draws_the_same_picture(tmp_path: Path) -> None:
    """In a process of its own, as two Mesas in one do not get on."""
    path = [*sys.path, str(Path(__file__).parents[2])]
    script = f"import sys; sys.path[:0] = {path!r}\n{WITH_OSMESA}"
    subprocess.run([sys.executable, "-c", script, str(tmp_path / "color.npy")], check=True)
    other = np.load(tmp_path / "color.npy")
    mine = Renderer((160, 90), samples=4).reference(Yard().scene(2)).color
    assert np.quantile(np.abs(other - mine), 0.999) < 0.02
