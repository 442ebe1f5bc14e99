"""A running `supersampler` command and its progress. Imports neither bpy nor supersampler."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from threading import Thread

_PATIENCE = 10.0  # seconds between the attempts to end a command
_LINES, _LINE = 1000, 4096  # maximum number of messages, and of characters in one


class Run:
    """A command in a process of its own; the caller polls it with `pump`.

    Attributes:
        total: number of frames.
        done: number of complete frames.
        notes: lines that the command has printed.
        error: why it failed; "" where it has not.

    The command stops when this process ends: see END_WITH_STDIN in `supersampler.cli.app`.

    Raises:
        OSError: there is no such program.
    """

    def __init__(self, command: Sequence[str], output: Path, total: int) -> None:
        self.total, self.done = total, 0
        self.notes: list[str] = []
        self.error = ""
        self._output = output
        self._cancelled: float | None = None  # time
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        group = {"creationflags": 0x200} if sys.platform == "win32" else {"start_new_session": True}
        self._process = subprocess.Popen(  # noqa: S603  # the preferences name the program
            list(command),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env={**variables, "SUPERSAMPLER_END_WITH_STDIN": "1"},
            **group,
        )
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def pump(self) -> bool:
        """Update the progress; return whether the command still runs."""
        self.done = min(self.total, self._count())
        if self._process.poll() is None:
            self._end_if_late()
            return True
        self._hang_up()
        self._reader.join(_PATIENCE)  # a program that the command started may hold the pipe
        if self._process.returncode and self._cancelled is None and not self.error:
            last = self.notes[-1] if self.notes else f"the command ended with {self._process.returncode}"
            self.error = last.removeprefix("error: ")
        return False

    def wait(self, seconds: float) -> bool:
        """Wait for at most `seconds`; return whether the command still runs."""
        self._reader.join(seconds)
        return self.pump()

    def cancel(self) -> None:
        """Ask the command to end, as Ctrl-C does: complete frames are kept. `pump` insists."""
        if self._cancelled is None:
            self._cancelled = time.monotonic()
            self._hang_up()

    def _hang_up(self) -> None:
        """Close the pipe that keeps the command running."""
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _end_if_late(self) -> None:
        """Terminate a cancelled command that is still running, and kill it if that does not help."""
        waited = 0.0 if self._cancelled is None else time.monotonic() - self._cancelled
        if waited > 2 * _PATIENCE:
            self._process.kill()
        elif waited > _PATIENCE:
            self._process.terminate()

    def _read(self) -> None:
        """Keep the last lines that the command prints, each of a bounded length."""
        if self._process.stderr is not None:
            with self._process.stderr as pipe:
                while line := pipe.readline(_LINE):
                    self.notes += [text] if (text := line.strip()) else []
                    del self.notes[:-_LINES]

    def _count(self) -> int:
        """Return how many frames upscale.json lists."""
        try:
            files = json.loads((self._output / "upscale.json").read_text(encoding="utf-8"))["files"]
            return int(min((count for pattern, count in files.items() if "#" in pattern), default=0))
        except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
            return 0  # not there yet, or of something else


def render_command(
    program: str,
    blend: str,
    output: Path,
    *,
    blender: str,
    frames: tuple[int, int],
    scene: str,
    scale: float | None,
    samples: int = 0,
    image_format: str = "exr",
    overwrite: bool = False,
) -> list[str]:
    """Return `supersampler blender ...`; samples of 0 are the command's own, a scale of None denoises."""
    command = [program, "blender", blend, "-o", str(output), "--blender", blender, "--scene", scene]
    command += ["--frames", f"{frames[0]}-{frames[1]}", "--format", image_format]
    command += ["--denoise", "temporal"] if scale is None else ["--scale", f"{scale:g}"]
    command += ["--samples", str(samples)] if samples else []
    return [*command, "--overwrite"] if overwrite else command


def upscale_command(
    program: str,
    folder: Path,
    output: Path,
    *,
    scale: float,
    image_format: str = "exr",
    overwrite: bool = False,
) -> list[str]:
    """Return `supersampler upscale ...` of frames that are there."""
    command = [program, "upscale", str(folder), "-o", str(output), "--scale", f"{scale:g}"]
    command += ["--format", image_format]
    return [*command, "--overwrite"] if overwrite else command


def denoise_command(
    program: str, folder: Path, output: Path, *, image_format: str = "exr", overwrite: bool = False
) -> list[str]:
    """Return `supersampler denoise ...` of frames that are there."""
    command = [program, "denoise", str(folder), "-o", str(output), "--format", image_format]
    return [*command, "--overwrite"] if overwrite else command
