"""Programs that step this version or another installed one in a new process, and print their times.

A program is given as text and uses the package alone, so the other environment needs no bench. Its argument
is a request as JSON; the last line that it prints is its answer, as JSON.
"""

import json
import os
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from supersampler.errors import ArgumentError
from supersampler.io.child_process import end_text, run

FIRST_IMAGE = """
import time
began = time.perf_counter()
import json, sys
import numpy as np
from supersampler import Frame, Upscaler
request = json.loads(sys.argv[1])
width, height = request["render"]
gray, still = np.full((height, width, 3), 0.5, np.float32), np.zeros((height, width, 2), np.float32)
frame = Frame(color=gray, depth=gray[..., 0].copy(), motion=still, jitter=(0.0, 0.0))
where = {"executor": request["executor"]} if "executor" in request else {"providers": "cpu"}
Upscaler(request["method"], scale=request["scale"], **where).step(frame)
print(json.dumps({"seconds": time.perf_counter() - began}))
"""
"""Prints the seconds from its first line to its first image. Request: method, render (width, height), scale;
executor, where the processor is not to be used.

The frame is made in memory, as an engine does; reading files is not timed.
"""
STEPS = """
import json, sys, time
import numpy as np
from supersampler import Frame, Upscaler
request = json.loads(sys.argv[1])
arrays, groups = dict(np.load(request["frames"])), {}
for name in [name for name in arrays if "." in name]:  # gbuffer.NAME, gbuffer_display.NAME
    group, _, key = name.partition(".")
    groups.setdefault(group, {})[key] = arrays.pop(name)
frames = [
    Frame(**{name: array[i] for name, array in arrays.items() if array[i].ndim > 1},
          jitter=tuple(map(float, arrays["jitter"][i])), exposure=float(arrays["exposure"][i]), **groups)
    for i in range(len(arrays["color"]))
]
width, height = request["display"]
upscaler = Upscaler(request["method"], display_size=(width, height), providers="cpu",
                    threads=request["threads"], validate="off")
image = np.empty((height, width, 3), np.float32)
wall, cores = [], []
for index in range(request["warm_up"] + request["steps"]):
    began, spent = time.perf_counter(), time.process_time()
    upscaler.step(frames[index % len(frames)], out=image)
    wall.append(time.perf_counter() - began)
    cores.append(time.process_time() - spent)
print(json.dumps({"wall": wall[request["warm_up"]:], "cores": cores[request["warm_up"]:]}))
"""
"""Prints the seconds of each step, wall time and time of all cores.

Request: method, frames (NPZ file), display (width, height), threads, warm_up (steps not counted), steps.
"""
_GIT_SECONDS = 30.0
_ABOUT = """
import json, os, platform, supersampler
folder = os.path.dirname(os.path.abspath(supersampler.__file__))
about = {"version": supersampler.__version__, "folder": folder, "python": platform.python_version()}
print(json.dumps(about))
"""


@dataclass(frozen=True)
class Version:
    """An installed version of the package.

    Attributes:
        name: "this" or "other".
        python: interpreter of the environment that has it.
        cache: folder for its compiled kernels.
    """

    name: str
    python: str
    cache: Path

    @cached_property
    def about(self) -> dict[str, Any]:
        """Version, Python, and the commit if the package is a git checkout, else None.

        Raises:
            ArgumentError: there is no such interpreter, or it has no supersampler.
        """
        about = self.run(_ABOUT)
        return {**about, "commit": commit(Path(about.pop("folder")))}

    def run(self, program: str, *, cache: Path | None = None, **request: Any) -> dict[str, Any]:
        """Run a program in a new process, and return its answer.

        Args:
            program: `FIRST_IMAGE` or `STEPS`.
            cache: folder for compiled kernels, instead of the version's own.
            request: what the program takes.

        Raises:
            ArgumentError: it fails; with its last message.
        """
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache or self.cache), "PYTHONSAFEPATH": "1"}
        if self.name == "other":
            environment.pop("PYTHONPATH", None)  # it may lead to this version
        command = [self.python, "-c", program.strip(), json.dumps(request)]
        try:
            done = run(command, environment=environment, seconds=None)
        except OSError as error:
            raise self._error(f"not to be started: {error.strerror}") from error
        answer = _last_line(done.stdout)
        if done.returncode or not answer:
            raise self._error(
                f"ended with {end_text(done.returncode)}: {_last_line(done.stderr)[:200]}".removesuffix(": ")
            )
        try:
            return dict(json.loads(answer))
        except ValueError:
            raise self._error(f"no Python: it prints {answer[:60]!r}") from None

    def _error(self, problem: str) -> ArgumentError:
        option, want = "--against", "an interpreter that has the other version of supersampler"
        if self.name == "this":
            option, want = "--methods", "methods that run in this version"
        return ArgumentError(option, got=f"{self.python}: {problem}", want=want)


def _last_line(output: bytes) -> str:
    lines = output.decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def commit(folder: Path) -> str | None:
    """Return the commit that a package's folder is a checkout of; None if it is none or git is missing."""
    with suppress(OSError, subprocess.SubprocessError):
        _git(folder, "ls-files", "--error-unmatch", "__init__.py")
        return _git(folder, "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12")
    return None


def _git(folder: Path, *command: str) -> str:
    done = run(["git", "-C", str(folder), *command], seconds=_GIT_SECONDS)
    done.check_returncode()
    return done.stdout.decode(errors="replace").strip()
