"""Record what Blender renders of `make_scene.py`: python record_blender.py BLENDER tests/blender.

recorded: the folder `render` of `supersampler blender`.
checked: shots, with rounded values. right: as that command renders. half, fixed: with half of the jitter that
the frames state, and with none. filtered: with Blender's own pixel filter, denoised.
"""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from compact_frames import compact, cropped
from supersampler.cli import app
from supersampler.conventions import halton_jitter
from supersampler.integrations.blender import render
from supersampler.io.shot import ShotWriter, open_source
from supersampler.io.shot.blender import read_render_record

HERE = Path(__file__).parent
NARROW, WIDE = '"BLACKMAN_HARRIS", 0.01', '"BLACKMAN_HARRIS", 1.5'  # Cycles takes a box to be 1 pixel wide
SHOTS = {  # fraction of the jitter, pixel filter, number of frames
    "right": (1.0, NARROW, 4),
    "half": (0.5, NARROW, 3),
    "fixed": (0.0, NARROW, 3),
    "filtered": (1.0, WIDE, 1),
}


def record_render(blender: str, folder: Path, work: Path) -> None:
    make_scene(blender, work, {"properties": {"scene.frame_end": 8}})
    run_command(blender, work, "recorded", "--samples", "1", "--denoise", "off")
    record = read_render_record(work / "recorded" / "render")
    assert record.scene is not None
    scene = msgspec.structs.replace(record.scene, ocio="/blender/config.ocio")
    msgspec.structs.replace(record, scene=scene).write(folder)
    for path in (work / "recorded" / "render").glob("*.exr"):
        shutil.copy(path, folder / path.name)


def record_shot(blender: str, folder: Path, name: str, work: Path) -> None:
    part, pixel_filter, count = SHOTS[name]
    script = work / "render_frames.py"
    setting = "scene.cycles.pixel_filter_type, scene.cycles.filter_width = "
    text, count_of_settings = re.subn(f"{setting}.*", setting + pixel_filter, render._SCRIPT.read_text())
    assert count_of_settings == 1
    script.write_text(text)
    render._SCRIPT = script
    vars(render)["halton_jitter"] = lambda index, scale: tuple(part * x for x in halton_jitter(index, scale))
    quality = ["256", "--denoise", "frame"] if name == "filtered" else ["64", "--denoise", "off"]
    run_command(blender, work, name, "--frames", f"6-{5 + count}", "--samples", *quality)
    writer = ShotWriter(folder / name, name=name, display_size=None, frame_rate=24, compression="zip:9")
    for index, item in enumerate(open_source(work / name / "render")):
        frame = replace(item.frame, jitter=halton_jitter(index, 2.0), gbuffer=None, aovs=None)
        writer.write(compact(cropped(frame, 120, 80)))


def make_scene(blender: str, work: Path, options: dict[str, Any]) -> None:
    words = [blender, str(HERE / "make_scene.py"), f"{work}/scene.blend", json.dumps(options)]
    subprocess.run(words, check=True)


def run_command(blender: str, work: Path, name: str, *options: str) -> None:
    words = ["blender", f"{work}/scene.blend", "-o", f"{work}/{name}", "--blender", blender, *options]
    app([*words, "--method", "bilinear"], standalone_mode=False)


def main(blender: str, folder: str) -> None:
    with TemporaryDirectory() as work:
        record_render(blender, Path(folder, "recorded"), Path(work))
        original = render._SCRIPT
        for name in SHOTS:
            size = [448, 294] if name == "filtered" else [192, 128]  # enough edges in a part of it
            make_scene(blender, Path(work), {"size": size})
            render._SCRIPT = original
            record_shot(blender, Path(folder, "checked"), name, Path(work))


main(*sys.argv[1:])
