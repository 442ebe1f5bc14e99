"""Fixtures that tests of several packages share."""

from pathlib import Path

import pytest

from gbuffer_method import exported


@pytest.fixture(scope="session")
def gbuffer_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a method that reads G-buffers, at a ratio of 2 and no other."""
    return exported(tmp_path_factory.mktemp("model") / "demodulated")
