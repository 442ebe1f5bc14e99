"""Tests of the examples with Mitsuba, of which one needs LLVM: `make mitsuba` runs them."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest

from commands import finished, ran

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPT = EXAMPLES / "mitsuba_sequence.py"


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed here")
def test_the_history_averages_the_noise_of_a_path_tracer() -> None:
    options = ["--size", "48", "--frames", "12", "--samples", "1", "4", "--reference-samples", "64"]
    done = finished(sys.executable, SCRIPT, *options)
    if done.returncode and "LLVM" in done.stderr:
        pytest.skip(f"Mitsuba has no LLVM that works here: {done.stderr.splitlines()[0]}")
    assert done.returncode == 0, done.stderr
    lines = [re.findall(r"([\d.]+) dB", line) for line in done.stdout.splitlines()]
    (bicubic_of_1, _, ours_of_1), (bicubic_of_4, _, ours_of_4, full_size) = [
        list(map(float, line)) for line in lines
    ]
    assert ours_of_1 > bicubic_of_1 + 1
    assert ours_of_4 > max(bicubic_of_4, full_size, ours_of_1) + 1


@pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed here")
@pytest.mark.skipif(importlib.util.find_spec("pyoidn") is None, reason="pyoidn is not installed here")
def test_neighbours_denoise_what_a_path_tracer_renders(tmp_path: Path) -> None:
    options = ("--size", 64, "--frames", 9, "--reference-samples", 256)
    said = ran(sys.executable, EXAMPLES / "mitsuba_denoise.py", "-o", tmp_path, *options)
    rendered, alone, over_time = map(float, re.findall(r"([\d.]+) dB", said))
    assert alone > rendered + 5
    assert over_time > alone + 0.3
    assert (tmp_path / "0008.exr").exists()
