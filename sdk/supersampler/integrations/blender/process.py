"""Rendering of a scene by Blender in a child process, and the messages of its script.

The script's messages and Blender's own output share one pipe. Each message begins with a random token that
this process generates for the run. No other line can pass for a message, although Blender prints names from
the .blend file verbatim, including their line breaks.
"""

import json
import os
import secrets
import shutil
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from threading import Condition, Thread
from typing import Protocol

from supersampler.errors import ArgumentError, ShotError, printable
from supersampler.io.child_process import GRACE, ChildProcess, end_text
from supersampler.io.files import LogFile
from supersampler.io.json_fields import Field
from supersampler.io.shot.blender import Camera, RenderedScene

_SCRIPT = Path(__file__).with_name("render_frames.py")  # imports bpy: not to be imported here
_SETTINGS = "SUPERSAMPLER_RENDER"  # environment variable of the script
_LAST_LINES = 20  # of Blender's own output, for an error of it
_LINE_BYTES = 1 << 20  # longest line that is read at once
_POLL = 0.5  # seconds between looks at a process that may have ended
_USUAL_PLACES = {
    "darwin": ("/Applications/Blender.app/Contents/MacOS/Blender",),
    "win32": ("Program Files/Blender Foundation/Blender */blender.exe",),
}


def find_blender(path: str | None = None) -> str:
    """Return the program that renders: `path`, or `blender` on the path, or where installers put it.

    Args:
        path: Blender, or a Python that has the module bpy; None looks for Blender.

    Raises:
        ArgumentError: there is none.
    """
    if path is not None:
        found = shutil.which(path)
        if found is None:
            want = "the path of Blender, or of a Python that has bpy"
            raise ArgumentError("--blender", got=f"{path}, which is no program", want=want)
        return found
    root = Path(Path.home().anchor)
    places = (sorted(root.glob(place.lstrip("/"))) for place in _USUAL_PLACES.get(sys.platform, ()))
    found = shutil.which("blender") or next((str(hit) for hits in places for hit in reversed(hits)), None)
    if found is None:
        hint = "Install it from blender.org; or a Python 3.11 with `pip install bpy` will do."
        raise ArgumentError("--blender", got="left out, and no Blender was found", want="its path", hint=hint)
    return found


class RenderTarget(Protocol):
    """Receives the frames of a render."""

    def note(self, line: str) -> None:
        """Receive a message about a setting that differs from that of the file."""

    def describe(self, scene: RenderedScene) -> None:
        """Receive the description of the scene; once, before the first frame."""

    def add(self, number: int, camera: Camera) -> None:
        """Receive the next frame, whose file is complete."""


class BlenderRender:
    """A running render; frames are complete in the order of their numbers.

    >>> with BlenderRender(find_blender(), blend, log, settings, target) as render:
    ...     render.wait_for_scene()
    ...     render.wait_for(0)

    Args:
        program: as `find_blender` returns it.
        blend: the scene's file; it is never written.
        log: receives Blender's output; it is closed with the render.
        settings: see `render_frames.main`, without "blend" and "token".
        target: receives the frames, in another thread; an error that it raises ends the render.

    Raises:
        ShotError: (of any method) Blender ended before its work was done; the message says why.
    """

    def __init__(
        self,
        program: str,
        blend: Path,
        log: LogFile,
        settings: Mapping[str, object],
        target: RenderTarget,
    ) -> None:
        self._blend, self._log, self._target = blend, log, target
        self._token = secrets.token_hex(16)
        self._has_scene = False
        self._count = 0  # frames that are complete
        self._error: str | ShotError = ""
        self._done = False
        self._changed = Condition()
        own = {**settings, "blend": str(blend.resolve()), "token": self._token}
        self._child = start_script(program, _SCRIPT, {_SETTINGS: json.dumps(own)})
        Thread(target=self._read, name="blender", daemon=True).start()

    def __enter__(self) -> "BlenderRender":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait_for_scene(self) -> None:
        """Wait until Blender has opened the file."""
        if not self._wait(lambda: self._has_scene):
            raise self._failure("before the first frame")

    def wait_for(self, index: int) -> None:
        """Wait until a frame is complete, by its place among those that are rendered."""
        if not self._wait(lambda: self._count > index):
            raise self._failure(f"after {self._count} frames" if self._count else "at the first frame")

    def close(self) -> None:
        """End Blender, if it still runs; frames that are complete stay."""
        self._child.close()
        with self._changed:
            self._changed.wait_for(lambda: self._done, GRACE)  # its last messages are read
            self._done = True
        self._log.close()

    def _wait(self, is_true: Callable[[], bool]) -> bool:
        """Wait until a condition holds, and return True; False where Blender has ended without it."""
        with self._changed:
            while not (is_true() or self._done):
                self._changed.wait(_POLL)
                if self._child.poll() is not None:  # a program that Blender started may hold the pipe
                    self._changed.wait_for(lambda: self._done, GRACE)
                    self._done = True
            return is_true()

    def _read(self) -> None:
        """Read Blender's output until it ends, or until there is an error, which ends Blender."""
        lines: deque[str] = deque(maxlen=_LAST_LINES)
        error: str | ShotError = ""
        try:
            for line in _lines(self._child):
                if line.startswith(self._token):
                    self._take(line.removeprefix(self._token))
                else:
                    self._log.write(line)
                    lines.append(line)
        except (ShotError, _ScriptError) as problem:
            error = problem if isinstance(problem, ShotError) else str(problem)
        except Exception as problem:  # a thread that ends in silence would leave the others waiting
            error = f"{type(problem).__name__}: {problem}"
        if not error:
            code = self._child.wait(GRACE)
            said = next((line for line in reversed(lines) if "Error" in line), lines[-1] if lines else "")
            error = f"Blender ended with {end_text(code)}{said and f': {said}'}"
        self._child.stop()
        with self._changed:
            self._error = error
            self._done = True
            self._changed.notify_all()

    def _take(self, text: str) -> None:
        """Process a message of the script.

        Raises:
            ShotError: it is no such message, or the frame cannot be stored.
            _ScriptError: the script reports an error.
        """
        content = Field(self._blend, "Blender's answer", json.loads(text))
        content.members()  # raises unless it is an object
        with self._changed:
            if "error" in content.value:
                raise _ScriptError(content["error"].of(str))
            if "scene" in content.value:
                self._target.describe(RenderedScene.of(content["scene"]))
                self._has_scene = True
            elif "frame" in content.value:
                self._target.add(content["frame"].of(int), Camera.of(content))
                self._count += 1
            else:
                self._target.note(printable(content["note"].of(str)))
            self._changed.notify_all()

    def _failure(self, when: str) -> ShotError:
        if isinstance(self._error, ShotError):
            return self._error
        error = self._error or f"Blender ended with {end_text(self._child.poll())}"
        problem = f"the render ended {when}: {printable(error).rstrip('.')}"
        return ShotError(self._blend, problem, f"Blender's output is in {self._log.path}.")


class _ScriptError(Exception):
    """The script cannot render the scene; the text says why."""


def start_script(program: str, script: Path, variables: Mapping[str, str]) -> ChildProcess:
    """Start a script in Blender; its output is all that either prints.

    Args:
        program: as `find_blender` returns it.
        script: a file.
        variables: environment variables for it. Those of this Python are not passed on: they would lead
            Blender's Python to packages of this one.
    """
    command = [program, str(script)]
    if not Path(program).stem.lower().startswith("python"):
        command = [program, "--background", "--python-exit-code", "1", "--python", str(script)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return ChildProcess(command, environment={**environment, **variables})


def _lines(child: ChildProcess) -> Iterator[str]:
    """Yield the lines of a program that are not empty; a very long one in parts."""
    assert child.output is not None  # noqa: S101  # it has a pipe
    with child.output as pipe:
        while line := pipe.readline(_LINE_BYTES):
            if text := line.decode(errors="replace").strip():
                yield text
