"""A running `supersampler` command and its progress. This module imports neither bpy nor supersampler."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Thread

_PATIENCE = 10.0  # seconds between attempts to end a command
_RECORD = 1 << 26  # maximum bytes of a record
_LINES, _LINE = 1000, 4096  # maximum number of messages, and of characters per message


class Run:
    """A command in a process of its own; the caller polls it with `pump`.

    Attributes:
        total: number of frames.
        done: number of complete frames.
        notes: lines that the command has printed.
        error: why the command failed, or "".

    The command ends with this process; see END_WITH_STDIN in `supersampler.cli.app`.

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
        self._reader.join(_PATIENCE)  # a child of the command may keep the pipe open
        if self._process.returncode and self._cancelled is None and not self.error:
            last = self.notes[-1] if self.notes else f"the command ended with {self._process.returncode}"
            self.error = last.removeprefix("error: ")
        return False

    def wait(self, seconds: float) -> bool:
        """Wait for at most `seconds`; return whether the command still runs."""
        self._reader.join(seconds)
        return self.pump()

    def cancel(self) -> None:
        """Ask the command to end, as Ctrl-C does; complete frames are kept. `pump` kills it if it is late."""
        if self._cancelled is None:
            self._cancelled = time.monotonic()
            self._hang_up()

    def _hang_up(self) -> None:
        """Close the pipe that keeps the command running."""
        if self._process.stdin is not None:
            self._process.stdin.close()

    def _end_if_late(self) -> None:
        """Terminate a cancelled command that is still running; later kill it."""
        waited = 0.0 if self._cancelled is None else time.monotonic() - self._cancelled
        if waited > 2 * _PATIENCE:
            self._process.kill()
        elif waited > _PATIENCE:
            self._process.terminate()

    def _read(self) -> None:
        """Keep the last lines that the command prints, truncated to _LINE characters."""
        if self._process.stderr is not None:
            with self._process.stderr as pipe:
                while line := pipe.readline(_LINE):
                    self.notes += [text] if (text := line.strip()) else []
                    del self.notes[:-_LINES]

    def _count(self) -> int:
        """Return the number of frames that upscale.json lists, and the records of ranges between cuts."""
        count = 0
        for path in self._output.glob("upscale*.json"):
            with suppress(OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError):
                if not path.is_file() or path.stat().st_size > _RECORD:  # a pipe would block Blender
                    continue
                files = json.loads(path.read_text(encoding="utf-8"))["files"]
                count += int(min((number for pattern, number in files.items() if "#" in pattern), default=0))
        return count  # another program's file counts as 0


def command_line(
    program: str, name: str, source: str | Path, output: Path, *, overwrite: bool, **options: object
) -> list[str]:
    """Return `supersampler NAME SOURCE -o OUTPUT` with the options that are not None."""
    command = [program, name, str(source), "-o", str(output), *(["--overwrite"] if overwrite else [])]
    for option, value in options.items():
        text = f"{value:g}" if isinstance(value, float) else str(value)
        command += [] if value is None else [f"--{option}", text]
    return command


def render_command(
    program: str,
    blend: str,
    output: Path,
    *,
    frames: tuple[int, int],
    scale: float | None,
    samples: int,
    overwrite: bool,
    **options: str,
) -> list[str]:
    """Return `supersampler blender ...`; 0 samples are the command's default, a scale of None denoises."""
    return command_line(
        program, "blender", blend, output, frames=f"{frames[0]}-{frames[1]}", samples=samples or None,
        scale=scale, denoise="temporal" if scale is None else None, overwrite=overwrite, **options,
    )  # fmt: skip
