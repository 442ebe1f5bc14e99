"""Rendering of a scene by Blender in a child process, and the messages that it prints."""

import json
import os
import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from threading import Condition, Thread
from typing import Protocol

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.json_fields import Field
from supersampler.io.shot.render_record import Camera, RenderedScene

_SCRIPT = Path(__file__).with_name("render_frames.py")  # imports bpy: not to be imported here
_PREFIX = "supersampler "  # of the lines that the script prints
_LAST_LINES = 20  # of Blender's own output, for an error of it
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

    def add(self, file: Path, camera: Camera) -> None:
        """Receive the next frame: its file, of a temporary name, and its camera."""


class BlenderRender:
    """A running render; frames are complete in the order of their numbers.

    >>> with BlenderRender(find_blender(), blend, folder, settings, target) as render:
    ...     render.wait_for_scene()
    ...     render.wait_for(0)

    Args:
        program: as `find_blender` returns it.
        blend: the scene's file; it is never written.
        folder: to render into. Blender's output is written to blender.log there.
        settings: see `render_frames.main`, without "blend" and "folder".
        target: receives the frames, in another thread; a ShotError that it raises ends the render.

    Raises:
        ShotError: (of any method) Blender ended before its work was done; the message says why.
    """

    def __init__(
        self,
        program: str,
        blend: Path,
        folder: Path,
        settings: Mapping[str, object],
        target: RenderTarget,
    ) -> None:
        self._blend, self._target = blend, target
        self._has_scene = False
        self._count = 0  # frames that are complete
        self._error: str | ShotError = "Blender gave no reason"
        self._done = False
        self._changed = Condition()
        file = folder / "settings.json"
        own = {**settings, "blend": str(blend.resolve()), "folder": str(folder.resolve())}
        file.write_text(json.dumps(own, indent=1), encoding="utf-8")
        self._log = (folder / "blender.log").open("w", encoding="utf-8")
        self._process = start_script(program, _SCRIPT, file)
        self._reader = Thread(target=self._read, name="blender", daemon=True)
        self._reader.start()

    def __enter__(self) -> "BlenderRender":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait_for_scene(self) -> None:
        """Wait until Blender has opened the file."""
        with self._changed:
            self._changed.wait_for(lambda: self._has_scene or self._done)
            if not self._has_scene:
                raise self._failure("before the first frame")

    def wait_for(self, index: int) -> None:
        """Wait until a frame is complete, by its place among those that are rendered."""
        with self._changed:
            self._changed.wait_for(lambda: self._count > index or self._done)
            if self._count <= index:
                raise self._failure(f"after {self._count} frames" if self._count else "at the first frame")

    def close(self) -> None:
        """End Blender, if it still runs; frames that are complete stay."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._log.close()

    def _read(self) -> None:
        """Read Blender's output until it ends."""
        lines: deque[str] = deque(maxlen=_LAST_LINES)
        has_failed = False
        assert self._process.stdout is not None  # noqa: S101  # it is a pipe
        for line in self._process.stdout:
            self._log.write(line)
            if line.startswith(_PREFIX) and not has_failed:
                has_failed = not self._take(line.removeprefix(_PREFIX))
            elif line.strip():
                lines.append(line.strip())
        code = self._process.wait()
        with self._changed:
            self._done = True
            if code and not has_failed:
                said = next((line for line in reversed(lines) if "Error" in line), lines[-1] if lines else "")
                self._error = f"Blender ended with {code}{said and f': {said}'}"
            self._changed.notify_all()

    def _take(self, text: str) -> bool:
        """Process a line of the script; return False at an error, which ends the render."""
        with self._changed:
            try:
                content = Field(self._blend, "Blender's answer", json.loads(text))
                if "error" in content.value:
                    self._error = content["error"].of(str)
                    self._process.terminate()  # a bpy whose scene has Python drivers hangs at its end
                    return False
                if "scene" in content.value:
                    self._target.describe(RenderedScene.of(content["scene"]))
                    self._has_scene = True
                elif "frame" in content.value:
                    self._target.add(Path(content["file"].of(str)), Camera.of(content))
                    self._count += 1
                else:
                    self._target.note(content["note"].of(str))
            except ShotError as error:
                self._error = error
                self._process.terminate()
                return False
            finally:
                self._changed.notify_all()
        return True

    def _failure(self, when: str) -> ShotError:
        if isinstance(self._error, ShotError):
            return self._error
        hint = f"Blender's output is in {self._log.name}."
        return ShotError(self._blend, f"the render ended {when}: {self._error.rstrip('.')}", hint)


def start_script(program: str, script: Path, settings: Path) -> "subprocess.Popen[str]":
    """Start a script in Blender with a file of settings; stdout has all that either prints.

    Variables of this Python are not passed on: they would lead Blender's Python to packages of this one.
    """
    command = [program, str(script), str(settings)]
    if not Path(program).stem.lower().startswith("python"):
        options = ["--background", "--python-exit-code", "1", "--python"]
        command = [program, *options, str(script), "--", str(settings)]
    return subprocess.Popen(  # noqa: S603  # the user names the program
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env={name: value for name, value in os.environ.items() if not name.startswith("PYTHON")},
    )
