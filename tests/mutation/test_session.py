"""A mutant may fail, crash, or never end: each is an outcome, and the next one is not touched."""

import os
import subprocess
import sys
from pathlib import Path

PROGRAM = """
import os, sys, time
from pathlib import Path
from mutation.session import Outcome, in_child

def fail():
    print("said")
    return Outcome(failed="a test", seconds={"a test": 1.0})

def crash():
    os._exit(3)

def hang():
    time.sleep(60.0)

log, started = Path(sys.argv[1]), time.monotonic()
print(in_child(fail, 20.0, log), log.read_text().strip())
print(in_child(crash, 20.0, log).failed)
print(in_child(hang, 1.0, log).failed, time.monotonic() - started < 20.0)
"""


def test_a_child_that_fails_crashes_or_hangs_is_an_outcome(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", "-c", PROGRAM, str(tmp_path / "log")]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "Outcome(failed='a test', seconds={'a test': 1.0}, lines={}) said",
        "the process ended with 3",
        "out of time True",
    ]
