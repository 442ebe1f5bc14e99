"""A renderer for the tests of this folder; without OpenGL they fail and name the package to install."""

import pytest

from supersampler_model.data.renderer.renderer import Renderer

DISPLAY = (160, 90)


@pytest.fixture(scope="session")
def renderer() -> Renderer:
    return Renderer(DISPLAY)
