"""Tiers of tests: `make test` leaves those out that are marked as long, `make test-all` runs all."""

from pathlib import Path

import pytest

LONG = ("fuzz", "gpu", "integrations", "mutation", "process", "test_examples.py")
"""Folders and files of tests that start processes, run software Vulkan or draw their inputs by chance."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    root = Path(__file__).parent
    for item in items:
        if item.path.relative_to(root).parts[0] in LONG:
            item.add_marker("long")
