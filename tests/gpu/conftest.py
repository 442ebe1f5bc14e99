"""Tests in this folder need a device; without one, all are skipped, with the reason."""

from typing import Any

import pytest

from gpu_steps import device_or_skip


@pytest.fixture(scope="module", autouse=True)
def device() -> Any:
    return device_or_skip()
