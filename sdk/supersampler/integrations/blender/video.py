"""Videos of frames, encoded by the ffmpeg that Blender has."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path

from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.integrations.blender.process import start_script
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
        with start_script(program, _SCRIPT, file) as process:
            try:
                output, _ = process.communicate()
            except BaseException:
                process.kill()
                raise
        if process.returncode or not partial.exists():
            said = [line for line in output.splitlines() if line.strip()][-1:] or ["nothing"]
            raise ShotError(path, f"Blender wrote no video; it said: {said[0].strip()}", "Has it FFmpeg?")
