"""Runs in Blender's own Python and writes images as a video: `python encode_video.py settings.json`.

Blender's ffmpeg encodes H.264 in mp4. Colours stay as the images have them. H.264 needs an even size: of an
odd one the last column or the first row is cut off.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

import bpy


def main(settings: dict[str, Any]) -> None:
    """Write the video.

    Args:
        settings: "images": files of equal size, in order; "size": their [width, height]; "frame_rate": frames
            a second; "video": file to write.
    """
    images = [Path(name) for name in settings["images"]]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    editor = scene.sequence_editor_create()
    strips = getattr(editor, "strips", None) or editor.sequences  # Blender 4.4 and later; before
    strip = strips.new_image("images", str(images[0]), channel=1, frame_start=1, fit_method="ORIGINAL")
    for path in images[1:]:
        strip.elements.append(path.name)
    width, height = settings["size"]
    scene.frame_start, scene.frame_end = 1, len(images)
    scene.view_settings.view_transform = "Standard"
    render, rate = scene.render, settings["frame_rate"]
    render.resolution_x, render.resolution_y, render.resolution_percentage = (
        width // 2 * 2,
        height // 2 * 2,
        100,
    )
    render.fps = max(1, math.ceil(rate))
    render.fps_base = render.fps / rate
    image = render.image_settings
    if hasattr(image, "media_type"):  # Blender 5
        image.media_type = "VIDEO"
    image.file_format, image.color_mode = "FFMPEG", "RGB"
    render.ffmpeg.format, render.ffmpeg.codec, render.ffmpeg.audio_codec = "MPEG4", "H264", "NONE"
    render.ffmpeg.constant_rate_factor = "PERC_LOSSLESS"
    render.filepath, render.use_file_extension = settings["video"], False
    bpy.ops.render.render(animation=True)


if __name__ == "__main__":
    main(json.loads(Path(sys.argv[-1]).read_text(encoding="utf-8")))
