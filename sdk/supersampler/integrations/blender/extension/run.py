"""A running `supersampler` command and its progress. Imports neither bpy nor supersampler."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread


class Run:
    """A command in a process of its own; whoever waits for it calls `pump` now and then.

    Attributes:
        total: number of frames.
        done: number of complete frames.
        notes: lines that the command has printed.
        error: why it failed; "" where it has not.

    Args:
        command: the program and its arguments.
        output: folder that it writes to.
        total: number of frames.

    Raises:
        OSError: there is no such program.
    """

    def __init__(self, command: Sequence[str], output: Path, total: int) -> None:
        self.total, self.done = total, 0
        self.notes: list[str] = []
        self.error = ""
        self._output, self._cancelled = output, False
        group = {"creationflags": 0x200} if sys.platform == "win32" else {"start_new_session": True}
        self._process = subprocess.Popen(  # noqa: S603  # the preferences name the program
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            encoding="utf-8",
            errors="replace",
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTHON")},
            **group,
        )
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def pump(self) -> bool:
        """Update the progress; return whether the command still runs."""
        self.done = min(self.total, self._count())
        if self._process.poll() is None:
            return True
        self._reader.join()
        if self._process.returncode and not self._cancelled and not self.error:
            last = self.notes[-1] if self.notes else f"the command ended with {self._process.returncode}"
            self.error = last.removeprefix("error: ")
        return False

    def wait(self, seconds: float) -> bool:
        """Wait so long at most; return whether the command still runs."""
        self._reader.join(seconds)
        return self.pump()

    def cancel(self) -> None:
        """End the command as Ctrl-C does: complete frames are kept."""
        self._cancelled = True
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)

    def _read(self) -> None:
        if self._process.stderr is not None:
            with self._process.stderr as lines:
                self.notes.extend(line.strip() for line in lines if line.strip())

    def _count(self) -> int:
        """Return how many frames upscale.json lists."""
        try:
            files = json.loads((self._output / "upscale.json").read_text(encoding="utf-8"))["files"]
        except (OSError, ValueError, KeyError):  # not there yet
            return 0
        return min((count for pattern, count in files.items() if "#" in pattern), default=0)


def render_command(
    program: str,
    blend: str,
    output: Path,
    *,
    blender: str,
    frames: tuple[int, int],
    scene: str,
    scale: float,
    samples: int = 0,
    image_format: str = "exr",
    overwrite: bool = False,
) -> list[str]:
    """Return `supersampler blender ...`; samples of 0 are the command's own."""
    command = [program, "blender", blend, "-o", str(output), "--blender", blender, "--scene", scene]
    command += ["--frames", f"{frames[0]}-{frames[1]}", "--scale", f"{scale:g}", "--format", image_format]
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
