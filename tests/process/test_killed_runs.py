"""A killed `upscale` leaves no half-written file, and the same command resumes it."""

import json
import os
import random
import subprocess
import sys
import time
from itertools import count
from pathlib import Path

import pytest

from upscale_runs import files, write_shot

pytest.importorskip("av")

ALL = int(os.environ.get("SUPERSAMPLER_KILLS", "6"))
"""Kills in the whole of this file; `make fuzz` does 200."""
RUNS = {"whole": (), "range": ("--frames", "3-18", "--preroll", "2")}


def start(shot: Path, output: Path, *options: str) -> "subprocess.Popen[bytes]":
    words = ["upscale", str(shot), "-o", str(output), "--method", "taau", "--threads", "1", "--json"]
    formats = ["--format", "exr", "--format", "png", "--format", "mp4"]
    return subprocess.Popen(
        [sys.executable, "-m", "supersampler", *words, *formats, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("kind", RUNS)
def test_a_run_killed_at_any_moment_continues_to_the_same_files(tmp_path: Path, kind: str) -> None:
    shot = write_shot(tmp_path / "shot", 30, cuts=(12,), light=1.02)
    whole = tmp_path / "whole" / "out"
    began = time.perf_counter()
    with start(shot, whole, *RUNS[kind]) as process:
        assert process.stdout is not None
        process.stdout.readline()
        until_begin = time.perf_counter() - began
        process.stdout.read()
        assert process.wait(timeout=280) == 0
    until_end = time.perf_counter() - began
    want, chance, kills, names = files(whole), random.Random(kind), 0, count()
    output = tmp_path / str(next(names)) / "out"
    while True:
        with start(shot, output, *RUNS[kind]) as process:
            assert process.stdout is not None
            if kills < ALL // len(RUNS):
                if chance.random() < 0.2:  # also before the first frame
                    time.sleep(chance.uniform(0.5, 1.1) * until_begin)
                else:
                    process.stdout.readline()
                    time.sleep(chance.uniform(0.0, until_end - until_begin))
                process.kill()
            process.stdout.read()
            code = process.wait(timeout=280)
        kills += code == -9
        found = files(output) if output.exists() else {}
        for name, data in found.items():
            if ".partial" in name:
                assert code == -9
            elif name.endswith(".json"):
                assert json.loads(data)["files"] is not None
            else:
                assert data == want[name]
        if code == -9:
            continue
        assert (code, [name for name in {**want, **found} if found.get(name) != want.get(name)]) == (0, [])
        if kills >= ALL // len(RUNS):
            break
        output = tmp_path / str(next(names)) / "out"
