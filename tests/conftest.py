"""Tiers of tests: `make test` leaves out those that are marked as long; `make test-all` runs all of them."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from supersampler_model.data.renderer.renderer import Renderer

LONG = ("fuzz", "gpu", "integrations", "mutation", "process", "test_examples.py")
"""Folders and files of tests that start processes, run software Vulkan or draw their inputs by chance."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    root = Path(__file__).parent
    for item in items:
        if item.path.relative_to(root).parts[0] in LONG:
            item.add_marker("long")


@pytest.fixture(scope="session")
def renderer() -> "Renderer":
    """Return a renderer of 160x90 images; without OpenGL it fails and names the package to install."""
    from supersampler_model.data.renderer.renderer import Renderer

    return Renderer((160, 90))
