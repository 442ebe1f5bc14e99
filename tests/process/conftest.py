"""What tests of kernel compilation share."""

import shutil
from pathlib import Path

import pytest

from supersampler import Model
from supersampler.backends.cpu.kernel_cache import cache_folder


@pytest.fixture
def cache_without_a_kernel(tmp_path: Path) -> Path:
    """For XDG_CACHE_HOME: all kernels of `taa` but the fastest to compile, which a process then compiles."""
    Model.load("taa", executor="cpu")
    folder = tmp_path / "cache" / "supersampler" / "kernels" / cache_folder().name
    shutil.copytree(cache_folder(), folder)
    (folder / "backends.cpu.kernels.frame.measure.kernel").unlink()
    return tmp_path / "cache"
