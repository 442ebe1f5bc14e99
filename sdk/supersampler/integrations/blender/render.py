"""Render a .blend file as a Shot in a child process of Blender: small with jitter, or at full size.

A later run can continue in the same folder. The script's messages and Blender's own output share one pipe.
Each message begins with a random token of the run, so that no other line can pass for a message: Blender
prints names from the .blend file verbatim, including line breaks.
"""

import hashlib
import json
import os
import re
import secrets
import shutil
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Thread
from typing import Literal, NamedTuple, Self

import msgspec

from supersampler.arguments import as_index, checked_scale, is_row
from supersampler.conventions import halton_jitter, jitter_phase_count
from supersampler.errors import ArgumentError, ShotError, printable, shown
from supersampler.frame import Size
from supersampler.io import files
from supersampler.io.child_process import GRACE, ChildProcess, end_text
from supersampler.io.json_files import decoded
from supersampler.io.shot import blender
from supersampler.io.shot.format import is_frame_range
from supersampler.io.shot.numbered import Range
from supersampler.io.shot.shot import Shot

Engine = Literal["cycles", "eevee", "workbench"]
_FRAMES = re.compile(r"\d{4,}\.exr|render\.json")
_SCRIPT = Path(__file__).with_name("render_frames.py")  # imports bpy, so it cannot be imported here
SETTINGS = "SUPERSAMPLER_RENDER"  # environment variable of the scripts
_SCALE = 2.0  # default scale of frames that are upscaled, as `render_frames.SCALE`
_OTHER_RENDER = "Choose another folder, or --overwrite to start over."
LAST_LINES = 20  # of Blender's output, which are searched for its error
_LINE_BYTES = 1 << 20  # maximum bytes per read
_POLL = 0.5  # seconds between checks whether the process has ended
_INSTALL_PATHS = {
    "darwin": ("/Applications/Blender.app/Contents/MacOS/Blender",),
    "win32": ("Program Files/Blender Foundation/Blender */blender.exe",),
}


@dataclass(frozen=True, kw_only=True)
class RenderRequest:
    """Settings of a render of a .blend file. None stands for the scene's own setting.

    Attributes:
        blend: the file; it is never written.
        frames: first and last number of the frames, both included.
        display_size: (width, height) of the upscaled images.
        scale: display over render size, >= 1, of frames that are upscaled; None is 2.
        samples: samples per render pixel; None is 16 if Cycles' frames are upscaled.
        denoise: "temporal": Cycles renders at full size without jitter, and denoises each frame, with the
            guides that denoising over time needs. "frame", "off": whether Cycles denoises small frames that
            are upscaled. None is "temporal" in Cycles, and "frame" with a scale.
        engine: render engine.
        camera, scene, view_layer: names in the file.
        keep_blur: whether motion blur and depth of field stay on; only with temporal denoising.
        part: fraction of the scene's width and height to render, if `display_size` is None.
        most: for a trial: number of frames in the middle of the scene's range, if `frames` is None. Trials
            do not sample adaptively. None for a normal render.
        seed: added to the scene's seed, for other noise.
        program: Blender, or a Python that has bpy; None searches for Blender.
        composite: whether `composite` will run the scene's compositor on the results. One that it cannot run
            is refused before anything is rendered.
    """

    blend: Path
    frames: Range | None = None
    display_size: Size | None = None
    scale: float | None = None
    samples: int | None = None
    denoise: blender.Denoising | None = None
    engine: Engine | None = None
    camera: str | None = None
    scene: str | None = None
    view_layer: str | None = None
    keep_blur: bool = False
    part: float = 1.0
    most: int | None = None
    seed: int = 0
    program: str | None = None
    composite: bool = False

    def settings(self) -> dict[str, object]:
        """Return all settings that the frames depend on, as JSON values, without the frame numbers.

        Raises:
            ArgumentError: a setting is out of range, or two contradict each other.
            ShotError: the file cannot be read.
        """
        if self.denoise == "temporal" and self.scale is not None:
            want = "one of the two: temporal denoising renders at full size"
            raise ArgumentError("scale", got=f"{self.scale:g}, with temporal denoising", want=want)
        if self.frames is not None and not _is_range(self.frames):
            raise ArgumentError("frames", got=shown(self.frames), want="(first, last), both >= 0, or None")
        with files.os_errors_as_shot_error(self.blend), self.blend.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        others = "frames", "program", "composite"
        settings = {name: value for name, value in vars(self).items() if name not in others}
        return settings | {
            "blend": digest,
            "display_size": self.display_size and list(self.display_size),
            "scale": None if self.scale is None else checked_scale(self.scale),
        }


def _is_range(frames: Sequence[object]) -> bool:
    ends = [as_index(number) for number in frames] if is_row(frames) else []
    if len(ends) != 2:
        return False
    first, last = ends
    return first is not None and last is not None and first >= 0 and is_frame_range(first, last)


class Rendering(NamedTuple):
    """A rendered scene and its frames.

    Attributes:
        scene: the scene, as Blender reports it.
        shot: the frames; reading one waits until it is rendered.
        cameras: returns the cameras and times of the complete frames.
    """

    scene: blender.RenderedScene
    shot: Shot
    cameras: Callable[[], Sequence[blender.RenderedCamera]]


@contextmanager
def rendering(
    request: RenderRequest, folder: Path, *, overwrite: bool = False, note: Callable[[str], None]
) -> Iterator[Rendering]:
    """Yield a scene and a Shot whose frames Blender renders in the background; reading one waits for it.

    Complete frames of an earlier call with the same request are kept. Blender ends with the block.

    Args:
        request: settings of the render.
        folder: folder for the frames, render.json and blender.log.
        overwrite: whether to remove the frames of an earlier call instead.
        note: called with each message about a setting that differs from the file's.

    Raises:
        ArgumentError: Blender was not found, or the request is out of range.
        ShotError: the .blend file cannot be rendered with these settings; or the folder has other files, or
            frames of another request.
    """
    files.check_is_file(request.blend)
    files.check_apart(folder, request.blend)
    rendered = _RenderFolder(folder, request, note)
    with files.FolderLock(folder) as lock:
        rendered.begin(overwrite=overwrite)
        if rendered.is_complete():
            yield rendered.rendering(lambda _: None, lambda: None)
            return
        program = find_blender(request.program)
        if lock.take_new():
            rendered.begin(overwrite=overwrite)
        log = rendered.prepare()
        yield from _rendered(rendered, program, log)


def _rendered(rendered: "_RenderFolder", program: str, log: files.LogFile) -> Iterator[Rendering]:
    """Yield a scene and its frames, which Blender renders in the background."""
    request, folder = rendered.request, rendered.path
    complete = len(rendered.record.frames)
    script = {
        **rendered.record.settings,
        "composite": request.composite,
        "frames": request.frames and list(request.frames),
        "jitter": rendered.record.jitter,
        "complete": complete,
        "folder": str(folder.resolve()),
        "run": rendered.run,
    }
    try:
        with BlenderRender(program, request.blend, log, script, rendered) as render:
            render.wait_for_scene()
            yield rendered.rendering(lambda index: render.wait_for(index - complete), render.close)
    finally:
        rendered.remove_incomplete()


class _RenderFolder:
    """Folder of the frames. A frame is listed in render.json before its file gets its final name.

    Attributes:
        run: part of the temporary names of this run's files.
    """

    def __init__(self, path: Path, request: RenderRequest, note: Callable[[str], None]) -> None:
        self.path, self.request, self.note = path, request, note
        self.run = secrets.token_hex(4)
        self._own: list[Path] = []  # frames of an earlier run
        settings = request.settings()
        scale = _SCALE if request.scale is None else request.scale
        jitter = tuple(halton_jitter(index, scale) for index in range(jitter_phase_count(scale)))
        first = 0 if request.frames is None else request.frames[0]
        self.record = blender.RenderRecord(settings=settings, first=first, jitter=jitter)

    def begin(self, *, overwrite: bool) -> None:
        """Keep the frames of an earlier run, or remove them; nothing else in the folder is changed.

        Raises:
            ShotError: the frames are of another request, or files of another program are in the way.
        """
        earlier = (
            blender.read_render_record(self.path) if files.is_there(self.path / blender.RENDER_FILE) else None
        )
        self._own = [] if earlier is None else [self.path / name for name in _files(earlier)]
        self._check_free()
        if overwrite:
            files.remove_files([*self._own, self.path / blender.RENDER_FILE])
            return
        if earlier is None or not earlier.frames:
            return
        self._check_same(earlier)
        missing = (i for i, name in enumerate(_files(earlier)) if not files.is_regular(self.path / name))
        frames = earlier.frames[: next(missing, len(earlier.frames))]
        self.record = msgspec.structs.replace(earlier, frames=frames)

    def prepare(self) -> files.LogFile:
        """Create the folder, remove incomplete files of killed runs, and return the log of this run."""
        with files.os_errors_as_shot_error(self.path, "written", files.NO_ROOM):
            self.path.mkdir(parents=True, exist_ok=True)
        self.remove_incomplete()
        log = files.LogFile(self.path / "blender.log", "Output of Blender, as `supersampler blender` ran it:")
        self.record.write(self.path)
        return log

    def remove_incomplete(self) -> None:
        """Remove incomplete files of this run and of killed runs."""
        files.remove_partial_files(self.path, _FRAMES.fullmatch)

    def is_complete(self) -> bool:
        """Return whether all requested frames exist."""
        return self.record.scene is not None and self._count() <= len(self.record.frames)

    def describe(self, scene: blender.RenderedScene) -> None:
        """Store the description of the scene; ShotError if the frames that exist show another scene."""
        if self.record.scene is not None and self.record.frames:
            self._check_scene(self.record.scene, scene)
        first = scene.numbers[0] if self.request.frames is None else self.request.frames[0]
        jitter = ((0.0, 0.0),) if scene.denoise == "temporal" else self.record.jitter
        self.record = msgspec.structs.replace(self.record, scene=scene, first=first, jitter=jitter)
        self.record.write(self.path)

    def add(self, number: int, camera: blender.RenderedCamera) -> None:
        """List the next frame, and give its file the final name.

        Raises:
            ShotError: another frame is next, another program's file has the name, or the disk refuses.
        """
        want = self.record.first + len(self.record.frames)
        if number != want:
            raise ShotError(self.path, f"Blender reports frame {number}; want {want}, the next one")
        path = self.path / blender.frame_file(number)
        self._check_ours(path)
        self.record = msgspec.structs.replace(self.record, frames=(*self.record.frames, camera))
        self.record.write(self.path)
        files.rename_partial(files.partial_name(path, self.run), path)

    def rendering(self, wait: Callable[[int], None], stop_waiting: Callable[[], None]) -> Rendering:
        """Return scene and Shot; `wait` is called with a frame's index before the frame is read."""
        assert self.record.scene is not None  # noqa: S101  # the callers wait for it

        def camera_of(index: int) -> blender.RenderedCamera:
            wait(index)
            return self.record.frames[index]

        shot = blender.rendered_shot(self.path, self.record, self._count(), camera_of, stop_waiting)
        return Rendering(self.record.scene, shot, lambda: self.record.frames)

    def _count(self) -> int:
        assert self.record.scene is not None  # noqa: S101  # the callers wait for it
        first, last = self.request.frames or self.record.scene.numbers
        return last + 1 - first

    def _check_free(self) -> None:
        for path in sorted(self.path.glob("[!.]*.exr")) if self.path.is_dir() else ():
            self._check_ours(path)

    def _check_ours(self, path: Path) -> None:
        files.check_ours(path, self._own.__contains__, f"listed by {blender.RENDER_FILE}")

    def _check_same(self, earlier: blender.RenderRecord) -> None:
        changed = [key for key, value in self.record.settings.items() if earlier.settings.get(key) != value]
        if changed:
            was, now = earlier.settings.get(changed[0]), self.record.settings[changed[0]]
            what = (
                "the file has changed" if changed[0] == "blend" else f"{changed[0]} was {was}, is now {now}"
            )
            raise ShotError(self.path, f"frames of another render are there: {what}", _OTHER_RENDER)
        requested = (
            self.request.frames[0] if self.request.frames else earlier.scene and earlier.scene.numbers[0]
        )
        if requested not in (None, earlier.first):
            problem = f"frames from {earlier.first} on are there; this render begins with {requested}"
            raise ShotError(self.path, problem, _OTHER_RENDER)

    def _check_scene(self, earlier: blender.RenderedScene, scene: blender.RenderedScene) -> None:
        """Raise ShotError if the scene has changed, as by a linked file; note another version of Blender."""
        for name, was in msgspec.structs.asdict(earlier).items():
            now = getattr(scene, name)
            if now == was or name in ("numbers", "ocio", "linear", "interop_id"):
                continue
            if name != "blender":
                problem = f"frames of another render are there: {name} was {was}, is now {now}"
                raise ShotError(self.path, problem, _OTHER_RENDER)
            self.note(f"Blender {printable(was)} has rendered the frames before, now it is {printable(now)}")


class Answer(msgspec.Struct, forbid_unknown_fields=True):
    """A message of a script: see `render_frames` and `composite_frames`."""

    error: str | None = None
    note: str | None = None
    scene: blender.RenderedScene | None = None
    frame: int | None = None
    extension: str = ""
    camera: blender.Rows | None = None
    shift: tuple[float, float] = (0.0, 0.0)
    seconds: float = 0.0
    world: blender.Rows | None = None


class BlenderRender:
    """A running render, which completes frames in order.

    >>> with BlenderRender(find_blender(), blend, log, settings, target) as render:
    ...     render.wait_for_scene()
    ...     render.wait_for(0)

    `settings` are the arguments of `render_frames.main`, without "blend" and "token". Another thread writes
    to `target`; an error of `target` ends the render.

    Raises:
        ShotError: (by any method) Blender ended before its work was done; the message says why.
    """

    def __init__(
        self,
        program: str,
        blend: Path,
        log: files.LogFile,
        settings: Mapping[str, object],
        target: _RenderFolder,
    ) -> None:
        self._blend, self._log, self._target = blend, log, target
        self._token = secrets.token_hex(16)
        self._has_scene = False
        self._count = 0  # frames that are complete
        self._error: str | ShotError = ""
        self._done = False
        self._changed = Condition()
        own = {**settings, "blend": str(blend.resolve()), "token": self._token}
        self._child = start_script(program, _SCRIPT, {SETTINGS: json.dumps(own)})
        Thread(target=self._read, name="blender", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def wait_for_scene(self) -> None:
        """Wait until Blender has opened the file."""
        if not self._wait(lambda: self._has_scene):
            raise self._failure("before the first frame")

    def wait_for(self, index: int) -> None:
        """Wait until the frame with this index in the render is complete."""
        if not self._wait(lambda: self._count > index):
            raise self._failure(f"after {self._count} frames" if self._count else "at the first frame")

    def close(self) -> None:
        """End Blender, if it still runs; complete frames are kept."""
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
                if self._child.poll() is not None:  # a child of Blender may keep the pipe open
                    self._changed.wait_for(lambda: self._done, GRACE)
                    self._done = True
            return is_true()

    def _read(self) -> None:
        """Read Blender's output until it ends, or until there is an error, which ends Blender."""
        lines = LastLines(maxlen=LAST_LINES)
        error: str | ShotError = ""
        try:
            for answer in answers(self._child, self._token, self._log, lines, self._blend):
                self._take(answer)
        except (ShotError, _ScriptError) as problem:
            error = problem if isinstance(problem, ShotError) else str(problem)
        except Exception as problem:  # otherwise the other threads would wait forever
            error = f"{type(problem).__name__}: {problem}"
        if not error:
            error = end_of_script(self._child, lines)
        self._child.stop()
        with self._changed:
            self._error = error
            self._done = True
            self._changed.notify_all()

    def _take(self, answer: Answer) -> None:
        """Process a message of the script.

        Raises:
            ShotError: the message is incomplete, or the frame cannot be stored.
            _ScriptError: the script reports an error.
        """
        with self._changed:
            if answer.error is not None:
                raise _ScriptError(answer.error)
            if answer.scene is not None:
                self._target.describe(answer.scene)
                self._has_scene = True
            elif answer.frame is not None and answer.camera is not None:
                camera = blender.RenderedCamera(answer.camera, answer.shift, answer.seconds, answer.world)
                self._target.add(answer.frame, camera)
                self._count += 1
            elif answer.note is not None:
                self._target.note(printable(answer.note))
            else:
                raise ShotError(self._blend, "Blender's answer has no note, scene, frame or error")
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
    """Start a script in Blender. Python's environment variables are not passed on to Blender's own Python."""
    command = [program, str(script)]
    if not Path(program).stem.lower().startswith("python"):
        command = [program, "--background", "--python-exit-code", "1", "--python", str(script)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return ChildProcess(command, environment={**environment, **variables})


LastLines = deque[str]
"""Last lines of Blender's own output."""


def answers(
    child: ChildProcess, token: str, log: files.LogFile, last: LastLines, blend: Path
) -> Iterator[Answer]:
    """Yield a script's messages until its output ends; write other lines to the log, and append them.

    Raises:
        ShotError: a message is invalid; the error names the file `blend`.
    """
    for line in _lines(child):
        if line.startswith(token):
            yield decoded(blend, line.removeprefix(token), Answer, "Blender runs another script.")
        else:
            log.write(line)
            last.append(line)


def end_of_script(child: ChildProcess, last: LastLines) -> str:
    """Return how Blender ended, with the last line of its output that has an error, or the last one."""
    code = child.wait(GRACE)
    line = next((line for line in reversed(last) if "Error" in line), last[-1] if last else "")
    return f"Blender ended with {end_text(code)}{line and f': {line}'}"


def _lines(child: ChildProcess) -> Iterator[str]:
    """Yield the non-empty lines of a program's output; a very long one in parts."""
    assert child.output is not None  # noqa: S101  # it has a pipe
    with child.output as pipe:
        while line := pipe.readline(_LINE_BYTES):
            if text := line.decode(errors="replace").strip():
                yield text


def find_blender(path: str | None = None) -> str:
    """Return the program that renders: `path`, or `blender` on the PATH or where installers put it.

    Args:
        path: Blender, or a Python that has the module bpy; None searches for Blender.

    Raises:
        ArgumentError: it was not found.
    """
    if path is not None:
        found = shutil.which(path)
        if found is None:
            want = "the path of Blender, or of a Python that has bpy"
            raise ArgumentError("--blender", got=f"{path}, which is not a program", want=want)
        return found
    root = Path(Path.home().anchor)
    places = (sorted(root.glob(place.lstrip("/"))) for place in _INSTALL_PATHS.get(sys.platform, ()))
    found = shutil.which("blender") or next((str(hit) for hits in places for hit in reversed(hits)), None)
    if found is None:
        hint = "Install it from blender.org, or `pip install bpy` with Python 3.11."
        raise ArgumentError(
            "--blender", got="not given, and no Blender was found", want="its path", hint=hint
        )
    return found


def _files(record: blender.RenderRecord) -> list[str]:
    """Return the names of the frames that a record lists."""
    return [blender.frame_file(record.first + index) for index in range(len(record.frames))]
