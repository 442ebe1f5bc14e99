"""Run the compositor of a .blend file on denoised or upscaled frames, in a child process of Blender."""

import json
import re
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

from supersampler.errors import ShotError, printable
from supersampler.integrations.blender.render import (
    LAST_LINES,
    SETTINGS,
    LastLines,
    Rendering,
    RenderRequest,
    answers,
    end_of_script,
    find_blender,
    start_script,
)
from supersampler.io import files
from supersampler.io.json_files import read_json

RECORD_FILE = "composite.json"
"""Lists the composited files beside it."""
_SCRIPT = Path(__file__).with_name("composite_frames.py")  # imports bpy, so it cannot be imported here
_FRAMES = re.compile(r"\d{4,}\.\w+")


def composite(
    request: RenderRequest,
    render: Rendering,
    results: Path,
    folder: Path,
    *,
    nodes: bool = True,
    motion_blur: bool = False,
    depth_of_field: bool = False,
    note: Callable[[str], None],
) -> Iterator[Path]:
    """Composite finished frames, and yield each file when it is written.

    Files have the format of the scene's output. Those of an earlier call are replaced.

    Args:
        request: request of the render.
        render: the scene and its frames, which are complete.
        results: folder of the denoised or upscaled frames, 0001.exr and so on.
        folder: folder to write to; composite.json lists its files.
        nodes: whether the scene's compositor nodes run.
        motion_blur: whether to add motion blur with the scene's shutter, by Vector Blur.
        depth_of_field: whether to add the depth of field of the scene's cameras, by Defocus.
        note: called with each message about a setting that differs from the file's.

    Raises:
        ArgumentError: Blender was not found.
        ShotError: the compositor needs a pass that no frame has, Blender ended, or a file of another program
            is in the way.
    """
    scene, first, count = render.scene, render.shot.first_number, len(render.shot)
    run, token = secrets.token_hex(4), secrets.token_hex(16)
    settings = {
        "blend": str(request.blend.resolve()), "scene": scene.name, "camera": request.camera,
        "layer": scene.layer, "size": scene.display_size, "first": first, "last": first + count - 1,
        "results": str(results.resolve()),
        "renders": str(render.shot.source.resolve()) if scene.denoise == "temporal" else None,
        "composite": nodes, "motion_blur": motion_blur, "depth_of_field": depth_of_field,
        "folder": str(folder.resolve()), "run": run, "token": token,
    }  # fmt: skip
    program = find_blender(request.program)
    with files.os_errors_as_shot_error(folder, "written", files.NO_ROOM):
        folder.mkdir(parents=True, exist_ok=True)
    log = files.LogFile(
        folder / "blender.log", "Output of Blender, as `supersampler blender` composited with it:"
    )
    listed, written, lines, error = _listed(folder), 0, LastLines(maxlen=LAST_LINES), ""
    child = start_script(program, _SCRIPT, {SETTINGS: json.dumps(settings)})
    try:
        with child:
            for answer in answers(child, token, log, lines, request.blend):
                if answer.error is not None:
                    error = answer.error
                    break
                if answer.note is not None:
                    note(printable(answer.note))
                elif answer.frame is not None:
                    yield _named(folder, f"{answer.frame:04d}{answer.extension}", run, listed)
                    written += 1
            if written < count:
                problem = printable(error or end_of_script(child, lines)).rstrip(".")
                hint = f"The frames are complete in {results}; Blender's output is in {log.path}."
                raise ShotError(
                    request.blend, f"its compositor ended after {written} frames: {problem}", hint
                )
    finally:
        log.close()
        files.remove_partial_files(folder, _FRAMES.fullmatch)


def _listed(folder: Path) -> set[str]:
    """Return the names of the files that earlier calls have composited."""
    names = read_json(folder / RECORD_FILE) if (folder / RECORD_FILE).exists() else []
    return {str(name) for name in names} if isinstance(names, list) else set()


def _named(folder: Path, name: str, run: str, listed: set[str]) -> Path:
    """List the next file, give it its final name, and return its path.

    Raises:
        ShotError: another program's file has the name, or the disk refuses.
    """
    path = folder / name
    if not _FRAMES.fullmatch(name):
        raise ShotError(path, "is not the name of a composited frame")
    files.check_ours(path, lambda path: path.name in listed, f"listed by {RECORD_FILE}")
    listed.add(name)
    files.write_text(folder / RECORD_FILE, json.dumps(sorted(listed)))
    files.rename_partial(files.partial_name(path, run), path)
    return path
