"""Render a .blend file small and with jitter, into a folder that a run can continue, as a Shot."""

import hashlib
import re
import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from supersampler.arguments import checked_scale
from supersampler.conventions import halton_jitter, jitter_phase_count
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Size
from supersampler.integrations.blender.process import BlenderRender, find_blender
from supersampler.io.files import (
    NO_ROOM,
    LogFile,
    check_apart,
    check_is_file,
    is_regular,
    is_there,
    os_errors_as_shot_error,
    partial_name,
    remove_files,
    remove_partial_files,
    rename_partial,
)
from supersampler.io.shot.blender import (
    RENDER_FILE,
    Camera,
    RenderedScene,
    RenderRecord,
    frame_file,
    read_render_record,
    rendered_shot,
)
from supersampler.io.shot.shot import Shot

Engine = Literal["cycles", "eevee", "workbench"]
_FRAMES = re.compile(r"\d{4,}\.exr|render\.json")


@dataclass(frozen=True, kw_only=True)
class RenderRequest:
    """What to render of a .blend file; None is the scene's own.

    Attributes:
        blend: the file; it is never written.
        frames: numbers of the first and the last frame.
        display_size: (width, height) of the upscaled images.
        scale: display over render size, >= 1.
        samples: of a render pixel; None is 16 in Cycles.
        denoise: whether Cycles denoises; None does.
        engine: of the render.
        camera, scene: names in the file.
        program: Blender, or a Python that has bpy; None looks for Blender.
    """

    blend: Path
    frames: tuple[int, int] | None = None
    display_size: Size | None = None
    scale: float = 2.0
    samples: int | None = None
    denoise: bool | None = None
    engine: Engine | None = None
    camera: str | None = None
    scene: str | None = None
    program: str | None = None

    def settings(self) -> dict[str, object]:
        """Return all settings that the frames depend on, but not their numbers; JSON values."""
        with os_errors_as_shot_error(self.blend), self.blend.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        return {
            "blend": digest,
            "display_size": None if self.display_size is None else list(self.display_size),
            "scale": checked_scale(self.scale),
            "samples": self.samples,
            "denoise": self.denoise,
            "engine": self.engine,
            "camera": self.camera,
            "scene": self.scene,
        }


@dataclass(frozen=True, slots=True)
class Rendering:
    """What is rendered: the scene, and its frames."""

    scene: RenderedScene
    shot: Shot


@contextmanager
def rendering(
    request: RenderRequest, folder: Path, *, overwrite: bool = False, note: Callable[[str], None]
) -> Iterator[Rendering]:
    """Yield a scene and a Shot, whose frames Blender renders meanwhile: reading one waits for it.

    Frames that an earlier call with the same request has completed are kept. Blender ends with the block.

    Args:
        request: what to render.
        folder: for the frames, render.json and blender.log.
        overwrite: remove the frames of an earlier call instead.
        note: called with each message about a setting that differs from that of the file.

    Raises:
        ArgumentError: there is no Blender, or the request is out of range.
        ShotError: the .blend file cannot be rendered so; or the folder holds other files, or frames of
            another request.
    """
    check_is_file(request.blend)
    check_apart(folder, request.blend)
    rendered = _RenderFolder(folder, request, note)
    rendered.begin(overwrite=overwrite)
    if rendered.is_complete():
        yield rendered.rendering(lambda _: None, lambda: None)
        return
    program = find_blender(request.program)
    log = rendered.prepare()
    complete = len(rendered.record.cameras)
    script = {
        **rendered.record.settings,
        "frames": request.frames,
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
    """The folder of the frames: a file is listed in render.json before it has its name.

    Attributes:
        run: part of the temporary names of this run's files.
    """

    def __init__(self, path: Path, request: RenderRequest, note: Callable[[str], None]) -> None:
        self.path, self.request, self.note = path, request, note
        self.run = secrets.token_hex(4)
        self._own: list[Path] = []  # files of an earlier run
        scale = request.scale
        settings = request.settings()
        jitter = tuple(halton_jitter(index, scale) for index in range(jitter_phase_count(scale)))
        first = 0 if request.frames is None else request.frames[0]
        self.record = RenderRecord(settings=settings, first=first, jitter=jitter)

    def begin(self, *, overwrite: bool) -> None:
        """Take over the frames of an earlier run, or remove them; nothing else in the folder is changed.

        Raises:
            ShotError: they are of another request; or files of another program are in the way.
        """
        earlier = read_render_record(self.path) if is_there(self.path / RENDER_FILE) else None
        self._own = [] if earlier is None else [self.path / name for name in _files(earlier)]
        self._check_free()
        if overwrite:
            remove_files([*self._own, self.path / RENDER_FILE])
            return
        if earlier is None or not earlier.cameras:
            return
        self._check_same(earlier)
        missing = (i for i, name in enumerate(_files(earlier)) if not is_regular(self.path / name))
        cameras = earlier.cameras[: next(missing, len(earlier.cameras))]
        self.record = replace(earlier, cameras=cameras)

    def prepare(self) -> LogFile:
        """Create the folder, remove what killed runs have not completed, and return the log of this run."""
        with os_errors_as_shot_error(self.path, "written", NO_ROOM):
            self.path.mkdir(parents=True, exist_ok=True)
        self.remove_incomplete()
        log = LogFile(self.path / "blender.log", "Output of Blender, as `supersampler blender` ran it:")
        self.record.write(self.path)
        return log

    def remove_incomplete(self) -> None:
        """Remove what this run or killed ones have not completed."""
        remove_partial_files(self.path, _FRAMES.fullmatch)

    def is_complete(self) -> bool:
        """Return whether all frames that are wanted are there."""
        return self.record.scene is not None and self._count() <= len(self.record.cameras)

    def describe(self, scene: RenderedScene) -> None:
        """Store the description of the scene."""
        first = scene.numbers[0] if self.request.frames is None else self.request.frames[0]
        self.record = replace(self.record, scene=scene, first=first)
        self.record.write(self.path)

    def add(self, number: int, camera: Camera) -> None:
        """List the next frame, and give its file its name.

        Raises:
            ShotError: another frame is next, another program's file has its name, or the disk refuses.
        """
        want = self.record.first + len(self.record.cameras)
        if number != want:
            raise ShotError(self.path, f"Blender reports frame {number}; want {want}, the next one")
        path = self.path / frame_file(number)
        if is_there(path) and path not in self._own:
            raise _unlisted(path)
        self.record = replace(self.record, cameras=(*self.record.cameras, camera))
        self.record.write(self.path)
        rename_partial(partial_name(path, self.run), path)

    def rendering(self, wait: Callable[[int], None], stop_waiting: Callable[[], None]) -> Rendering:
        """Return scene and Shot; `wait` is called with a frame's index before it is read."""
        assert self.record.scene is not None  # noqa: S101  # the callers wait for it

        def camera_of(index: int) -> Camera:
            wait(index)
            return self.record.cameras[index]

        shot = rendered_shot(self.path, self.record, self._count(), camera_of, stop_waiting)
        return Rendering(self.record.scene, shot)

    def _count(self) -> int:
        assert self.record.scene is not None  # noqa: S101  # the callers wait for it
        first, last = self.request.frames or self.record.scene.numbers
        return last - first + 1

    def _check_free(self) -> None:
        for path in sorted(self.path.glob("*.exr")) if self.path.is_dir() else ():
            if path.name[0] != "." and not (path in self._own and is_regular(path)):
                raise _unlisted(path)

    def _check_same(self, earlier: RenderRecord) -> None:
        hint = "Choose another folder, or --overwrite to start over."
        changed = [key for key, value in self.record.settings.items() if earlier.settings.get(key) != value]
        if changed:
            was, now = earlier.settings.get(changed[0]), self.record.settings[changed[0]]
            what = (
                "the file has changed" if changed[0] == "blend" else f"{changed[0]} was {was}, is now {now}"
            )
            raise ShotError(self.path, f"frames of another render are there: {what}", hint)
        wanted = self.request.frames or (earlier.scene.numbers if earlier.scene is not None else None)
        if wanted is not None and wanted[0] != earlier.first:
            problem = f"frames from {earlier.first} on are there; this render begins with {wanted[0]}"
            raise ShotError(self.path, problem, hint)


def _unlisted(path: Path) -> ShotError:
    problem = f"is there already, and {RENDER_FILE} does not list it"
    return ShotError(path, problem, "Move it away, or choose another folder.")


def _files(record: RenderRecord) -> list[str]:
    """Return the names of the frames that a record lists."""
    return [frame_file(record.first + index) for index in range(len(record.cameras))]


def frame_range(text: str) -> tuple[int, int]:
    """Parse "1-48" as (1, 48) and "12" as (12, 12); ArgumentError for anything else."""
    found = re.fullmatch(r"\s*(\d{1,9})\s*(?:-\s*(\d{1,9})\s*)?", text)
    first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
    if first > last:
        raise ArgumentError("--frames", got=repr(text), want="FIRST-LAST, such as 1-48, or one number")
    return first, last
