"""Test of the example with Mitsuba, which needs LLVM: `make mitsuba` runs it."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "mitsuba_sequence.py"


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed here")
def test_the_history_averages_the_noise_of_a_path_tracer() -> None:
    options = ["--size", "48", "--frames", "12", "--samples", "1", "4", "--reference-samples", "64"]
    done = subprocess.run([sys.executable, SCRIPT, *options], capture_output=True, text=True, timeout=300)
    if done.returncode and "LLVM" in done.stderr:
        pytest.skip(f"Mitsuba has no LLVM that works here: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr
    lines = [re.findall(r"([\d.]+) dB", line) for line in done.stdout.splitlines()]
    (bicubic_of_1, _, ours_of_1), (bicubic_of_4, _, ours_of_4, full_size) = [
        list(map(float, line)) for line in lines
    ]
    assert ours_of_1 > bicubic_of_1 + 1
    assert ours_of_4 > max(bicubic_of_4, full_size, ours_of_1) + 1
