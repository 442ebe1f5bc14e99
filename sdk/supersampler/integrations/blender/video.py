"""Videos of frames, encoded by the ffmpeg that Blender has."""

import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.integrations.blender.process import blender_command, blender_environment
from supersampler.io.atomic import replacing

_SCRIPT = Path(__file__).with_name("encode_video.py")  # imports bpy: not to be imported here


def write_video(program: str, images: Sequence[Path], size: Size, frame_rate: float, path: Path) -> None:
    """Write images as an mp4 file, H.264 of an even size, whole or not at all.

    Args:
        program: as `find_blender` returns it.
        images: files in one folder, in order.
        size: their (width, height).
        frame_rate: frames a second.
        path: of the video.

    Raises:
        ShotError: Blender wrote none; the message has the last line of what it said.
    """
    with replacing(path) as partial, tempfile.TemporaryDirectory() as folder:
        settings = {
            "images": [str(image.resolve()) for image in images],
            "size": size,
            "frame_rate": frame_rate,
            "video": str(partial.resolve()),
        }
        file = Path(folder) / "settings.json"
        file.write_text(json.dumps(settings), encoding="utf-8")
        done = subprocess.run(  # noqa: S603  # the user names the program
            blender_command(program, _SCRIPT, file),
            check=False,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
            env=blender_environment(),
        )
        if done.returncode or not partial.exists():
            said = [line for line in done.stdout.splitlines() if line.strip()][-1:] or ["nothing"]
            raise ShotError(path, f"Blender wrote no video; it said: {said[0].strip()}", "Has it FFmpeg?")
