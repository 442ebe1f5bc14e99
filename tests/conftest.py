"""Tiers of tests: `make test` leaves out those that are marked as long; `make test-all` runs all of them."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from native_build import native_build
from supersampler.backends.onnx import session
from supersampler.methods.model_file import is_shipped

if TYPE_CHECKING:
    from supersampler_model.data.renderer.renderer import Renderer

LONG = {
    "export/test_export_traced.py": "traces graphs, up to a minute each",
    "fuzz": "draws inputs by chance",
    "gpu": "runs software Vulkan",
    "integrations": "starts other programs",
    "process": "starts processes",
    "test_examples.py": "runs every example",
}
"""Folders and files of tests that are long, and why. A single test is marked where it stands."""


def pytest_configure(config: pytest.Config) -> None:
    """Build the CPU library from the sources that are tested; only what has changed is compiled."""
    if not hasattr(config, "workerinput"):  # one of several processes, whose parent has built it
        native_build().build()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = [Path(__file__).parent / name for name in LONG]
    assert all(place.exists() for place in places), "a place of long tests has another name"
    long = {path for path in {item.path for item in items} if not {path, *path.parents}.isdisjoint(places)}
    for item in items:
        if item.path in long:
            item.add_marker("long")


@pytest.fixture(scope="session", autouse=True)
def shipped_graphs_are_opened_once() -> Iterator[None]:
    """Share ONNX Runtime's sessions of shipped graphs in a process: opening one takes half a second."""
    opened: dict[str, Any] = {}
    open_session = session.open_session

    def shared(path: Path, *args: Any, **options: Any) -> Any:
        key = str((path, args, options))
        if not is_shipped(path) or key not in opened:
            opened[key] = open_session(path, *args, **options)
        return opened[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "open_session", shared)
        yield


@pytest.fixture(scope="session")
def renderer() -> "Renderer":
    """Return a renderer of 160x90 images; without OpenGL it fails and names the package to install."""
    from supersampler_model.data.renderer.renderer import Renderer

    return Renderer((160, 90))


@pytest.fixture(scope="module", autouse=True)
def device(request: pytest.FixtureRequest) -> Any:
    """Return the device for tests in gpu/; without one all of them are skipped, with the reason."""
    if request.path.parent.name != "gpu":
        return None
    from gpu_steps import device_or_skip

    return device_or_skip()
