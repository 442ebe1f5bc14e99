"""Record what Blender renders of `make_scene.py`, as small shots: python record.py BLENDER FOLDER.

right: as `supersampler blender` renders. half, fixed: with half of the jitter that the frames state, and with
none. filtered: with Blender's own pixel filter.
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from compact_frames import compact
from supersampler.cli import app
from supersampler.conventions import halton_jitter
from supersampler.integrations.blender import process, render
from supersampler.io.shot import ShotWriter, open_source

HERE = Path(__file__).parent
NARROW = '"BOX", EXACT_FILTER'
SHOTS = {"right": (1.0, NARROW, 4), "half": (0.5, NARROW, 3), "fixed": (0.0, NARROW, 3), "filtered": (1.0, '"BLACKMAN_HARRIS", 1.5', 1)}


def record(blender: str, folder: Path, name: str, work: Path) -> None:
    part, pixel_filter, count = SHOTS[name]
    script = work / "render_frames.py"
    script.write_text(process._SCRIPT.read_text().replace(NARROW, pixel_filter))
    process._SCRIPT = script
    render.halton_jitter = lambda index, scale: tuple(part * x for x in halton_jitter(index, scale))
    options = ["--samples", "64", "--frames", f"6-{5 + count}", "--method", "bilinear", "--blender", blender]
    app(["blender", str(work / "scene.blend"), "-o", str(work / name), *options], standalone_mode=False)
    writer = ShotWriter(folder / name, name=name, display_size=(192, 128), frame_rate=24, compression="zip:9")
    for index, item in enumerate(open_source(work / name / "render")):
        writer.write(compact(replace(item.frame, jitter=halton_jitter(index, 2.0), gbuffer=None, aovs=None)))


def main(blender: str, folder: str) -> None:
    with TemporaryDirectory() as work:
        make = [blender, str(HERE / "make_scene.py"), f"{work}/scene.blend", '{"size": [192, 128]}']
        subprocess.run(make, check=True)
        original = process._SCRIPT
        for name in SHOTS:
            process._SCRIPT = original
            record(blender, Path(folder), name, Path(work))


main(*sys.argv[1:])
