"""Cases for the JavaScript readers of examples/web, run by Node.js; without it, their tests are skipped."""

import json
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from noise import noise
from supersampler.io.shot import ShotWriter

NODE = shutil.which("node")
READ_CASES = Path(__file__).parent / "fuzz" / "javascript" / "read_cases.mjs"
HEAP = "--max-old-space-size=256"  # MiB
PEAK = 600 << 20
"""Bytes of memory of the process in Node.js, which takes 100 MiB without a case."""

if NODE is None:
    pytest.skip("Node.js is not installed here", allow_module_level=True)


def answers(
    kind: str, base: Path, cases: Sequence[Mapping[str, bytes]], work: Path, *, seconds: float = 280.0
) -> list[str]:
    """Return the reader's answer to each case, "read" or its error; errors of other classes fail the test.

    Args:
        kind: key of READERS in read_cases.mjs.
        base: folder of the whole files.
        cases: contents of the files that each case replaces, by name.
        work: folder for the cases.
        seconds: time limit of all cases together.
    """
    for number, files in enumerate(cases):
        for name, data in files.items():
            path = work / "cases" / str(number) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        (work / "cases" / str(number)).mkdir(parents=True, exist_ok=True)
    command = [NODE, HEAP, READ_CASES, kind, base, work / "cases", 0, len(cases), PEAK]
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=seconds, check=False
    )
    shutil.rmtree(work / "cases")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert [line for line in lines if "raised" in line] == []
    said = [line["said"] for line in lines if "said" in line]
    assert len(said) == len(cases), f"case {len(said)}: {done.stderr[-2000:]}"
    return said


def write_tiny(folder: Path) -> bytes:
    """Write a shot of two frames, one with a reference, and return its shot.json."""
    with ShotWriter(folder, name="tiny", display_size=(64, 36), frame_rate=30) as writer:
        writer.write(noise(0))
        writer.write(noise(1, exposure=0.5), reference=np.zeros((36, 64, 3), np.float32))
    return (folder / "shot.json").read_bytes()
