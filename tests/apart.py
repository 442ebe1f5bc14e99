"""Python code in a process of its own, for tests of the SDK's effects on its process."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from supersampler import Model
from supersampler.backends.cpu.kernel_cache import cache_folder

TESTS = Path(__file__).parent
STEP = """
import numpy as np
from noise import noise
from supersampler import Frame, Upscaler
def upscaler(method="classifier", **options):
    return Upscaler(method, **{"display_size": (64, 36), "threads": 2, "validate": "off", **options})
"""
"""First lines of most of these tests: `noise(seed)` is a frame of 32x18."""


def run_apart(
    code: str, *options: str, seconds: float = 120.0, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run code, with Python's `options`; the test fails where it raises, crashes or takes longer.

    Returns:
        The process, with what it printed.
    """
    path = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, *options, "-c", code],
        capture_output=True,
        text=True,
        timeout=seconds,
        env={**os.environ, "PYTHONPATH": path, **environment},
        check=False,
    )
    assert done.returncode == 0, f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done


def cache_without_a_kernel(folder: Path) -> str:
    """Make a value of XDG_CACHE_HOME: kernels of `taa` but the fastest to compile, which a step compiles."""
    Model.load("taa", executor="cpu")
    kernels = folder / "supersampler" / "kernels" / cache_folder().name
    shutil.copytree(cache_folder(), kernels)
    (kernels / "backends.cpu.kernels.frame.measure.kernel").unlink()
    return str(folder)
