"""Processes of another installed version, which step and report their times.

The programs that run there are given as text and use only what every version has, so the other environment
needs the package alone, without its bench.
"""

import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryDirectory, TemporaryFile
from typing import IO, Any, cast

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler_bench.timing.startup import FIRST_IMAGE

_SERVE = """
import json, os, platform, sys, time
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)  # what libraries print is no answer

def answer(**values):
    answers.write(json.dumps(values) + "\\n")
    answers.flush()

def load(method, frames, display, threads):
    arrays = dict(np.load(frames))
    groups = {}
    for name in [name for name in arrays if "." in name]:
        group, _, key = name.partition(".")
        groups.setdefault(group, {})[key] = arrays.pop(name)
    made = []
    for color, depth, motion, (x, y), exposure in zip(
        *(arrays[name] for name in ("color", "depth", "motion", "jitter", "exposure"))
    ):
        seen = {"color": color, "depth": depth, "motion": motion, "exposure": float(exposure)}
        made.append(Frame(jitter=(float(x), float(y)), **seen, **groups))
    upscaler = Upscaler(
        method, display_size=tuple(display), providers="cpu", threads=threads, skip="exact", validate="off"
    )
    image = np.empty((display[1], display[0], 3), np.float32)
    ready[method] = upscaler, made, image, [0]
    step(method, 2, 0)
    return {}

def step(method, settling, count):
    upscaler, frames, image, done = ready[method]
    wall, cores = [], []
    for index in range(settling + count):
        frame = frames[done[0] % len(frames)]
        done[0] += 1
        began, spent = time.perf_counter(), time.process_time()
        upscaler.step(frame, out=image)
        took, used = time.perf_counter() - began, time.process_time() - spent
        if index >= settling:
            wall.append(took)
            cores.append(used)
    return {"wall": wall, "cores": cores}

try:
    import supersampler
    import numpy as np
    from supersampler import Frame, Upscaler
    ready = {}
    folder = os.path.dirname(os.path.abspath(supersampler.__file__))
    answer(version=supersampler.__version__, folder=folder, python=platform.python_version())
    for line in sys.stdin:
        request = json.loads(line)
        answer(**{"load": load, "step": step}[request.pop("do")](**request))
except Exception as error:
    answer(error=f"{type(error).__name__}: {error}")
"""
_WANT = "an interpreter that has the other version of supersampler"


@dataclass(frozen=True)
class Times:
    """Milliseconds of a step: median wall time, mean time of all cores together."""

    wall: float
    cores: float


class Process:
    """A process that steps when it is asked to.

    Attributes:
        about: what runs there: version, folder and python.
    """

    def __init__(self, version: "Version", process: "subprocess.Popen[bytes]", stderr: IO[bytes]) -> None:
        self._version, self._process, self._stderr = version, process, stderr
        self._requests, self._answers = cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)
        self.about = self._answer()

    def load(self, method: str, frames: Path, display: Size, threads: int) -> None:
        """Get a method ready, and warm it up.

        Raises:
            ArgumentError: that version has no such method, or the process died.
        """
        self._ask(do="load", method=method, frames=str(frames), display=list(display), threads=threads)

    def step(self, method: str, settling: int, count: int) -> Times:
        """Time `count` steps, after `settling` that do not count.

        Raises:
            ArgumentError: the process died.
        """
        answer = self._ask(do="step", method=method, settling=settling, count=count)
        return Times(1e3 * median(answer["wall"]), 1e3 * fmean(answer["cores"]))

    def _ask(self, **request: Any) -> dict[str, Any]:
        with suppress(BrokenPipeError):  # it has died: there is no answer
            self._requests.write(json.dumps(request).encode() + b"\n")
        return self._answer()

    def _answer(self) -> dict[str, Any]:
        line = self._answers.readline()
        if not line:
            raise self._version.error(_ended(self._process.wait(), self._stderr))
        try:
            answer: dict[str, Any] = json.loads(line)
        except ValueError:
            raise self._version.error(f"no Python: it prints {line[:60]!r}") from None
        if "error" in answer:
            raise self._version.error(answer["error"])
        return answer


class Version:
    """One version.

    Args:
        name: "this" or "other".
        python: interpreter of an environment that has it.
        cache: folder for its kernels, and for nothing else.

    Attributes:
        about: version, commit where it is a checkout, and Python.

    Raises:
        ArgumentError: there is no such interpreter, or it has no supersampler.
    """

    def __init__(self, name: str, python: str, cache: Path) -> None:
        self.name, self._python, self._cache = name, python, cache
        with self.process() as process:
            about = process.about
        commit = _commit(Path(about.pop("folder")))
        self.about: Mapping[str, Any] = {**about, "commit": commit}

    @contextmanager
    def process(self) -> Iterator[Process]:
        """Start a process that stays until the end of the context.

        Raises:
            ArgumentError: it does not start.
        """
        with TemporaryFile() as stderr:
            pipe = subprocess.PIPE
            try:
                process = subprocess.Popen(  # noqa: S603  # what the user names
                    [self._python, "-c", _SERVE],
                    stdin=pipe,
                    stdout=pipe,
                    stderr=stderr,
                    bufsize=0,
                    env=self._environment(self._cache),
                )
            except OSError as error:
                raise self.error(f"not to be started: {error.strerror}") from error
            with process:
                try:
                    yield Process(self, process, stderr)
                finally:
                    process.kill()

    def first_image(self, method: str, render: Size, scale: float, *, fresh: bool) -> float:
        """Run a program of one frame; return milliseconds from its first line to its first image.

        Args:
            method: name of a model.
            render: (width, height) of the frame.
            scale: display over render size.
            fresh: whether no kernels are kept from earlier programs.

        Raises:
            ArgumentError: it fails.
        """
        command = [self._python, "-c", FIRST_IMAGE, method, *map(str, render), str(scale)]
        with TemporaryDirectory() as empty, TemporaryFile() as stderr:
            environment = self._environment(Path(empty) if fresh else self._cache)
            done = subprocess.run(  # noqa: S603  # as above
                command, stdout=subprocess.PIPE, stderr=stderr, env=environment
            )
            if done.returncode:
                raise self.error(_ended(done.returncode, stderr))
            return 1e3 * float(done.stdout)

    def error(self, got: str) -> ArgumentError:
        """What to raise where this side does not do what it is asked to."""
        hint = "" if self.name == "other" else "That is this version itself."
        return ArgumentError("--against", got=f"{self._python}: {got}", want=_WANT, hint=hint)

    def _environment(self, cache: Path) -> dict[str, str]:
        """Ours, with kernels kept apart; the other version must not be found where this one was."""
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "PYTHONSAFEPATH": "1"}
        if self.name == "other":
            environment.pop("PYTHONPATH", None)
        return environment


def _ended(code: int, stderr: IO[bytes]) -> str:
    """Say how a process ended: by which signal, or with which code and last line."""
    if code < 0:
        return f"ended by signal {-code}"
    stderr.seek(0)
    lines = stderr.read().decode(errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "")
    return f"ended with code {code}{': ' * bool(last)}{last[:200]}"


def _commit(folder: Path) -> str | None:
    """Return the commit that a package's folder is a checkout of; None where it is none or git is missing."""
    with suppress(OSError, subprocess.CalledProcessError):
        _git(folder, "ls-files", "--error-unmatch", "__init__.py")
        return _git(folder, "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12")
    return None


def _git(folder: Path, *command: str) -> str:
    done = subprocess.run(  # noqa: S603  # git alone
        ["git", "-C", str(folder), *command],  # noqa: S607  # the one on PATH
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()
