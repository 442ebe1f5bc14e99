"""Python code in a process of its own, for tests of the SDK's effects on its process."""

import os
import subprocess
import sys
from pathlib import Path

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
    code: str, *options: str, seconds: float = 280.0, **environment: str
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
