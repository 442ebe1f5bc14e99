"""Record a part of frames that Cycles has rendered, denoised one by one: python record_denoised.py RENDERS.

RENDERS is a folder of denoise_scenes.py (bench/supersampler_bench/quality), with courtyard-4 and references.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from compact_frames import compact
from supersampler.denoising.oidn import Oidn
from supersampler.denoising.sequence import guides_of
from supersampler.frame import Array, Float32
from supersampler.io.shot import ShotWriter, import_blender
from supersampler_bench.cli.options import REFERENCES
from supersampler_bench.quality.denoise_references import find_references, read_reference

FOLDER = Path(__file__).with_name("denoised")
NUMBERS = range(11, 16)  # a reference with two frames to either side, and two more references
PART = slice(136, 200), slice(290, 386)  # rows and columns: spokes before brick, behind wire; slats


def main(renders: Path) -> None:
    render = renders / "courtyard-4"
    shot = import_blender(render, guides="denoising")
    references = find_references(render, "courtyard", REFERENCES)
    height, width = (part.stop - part.start for part in PART)
    writer = ShotWriter(
        FOLDER, name="denoised", display_size=(width, height), frame_rate=24,
        compression="zip:9", reference_compression="zip:9",
    )  # fmt: skip
    with Oidn(threads=1) as oidn:
        for number in NUMBERS:
            frame = shot.read(number - shot.first_number).frame
            albedo, normal = oidn.clean_guides(*guides_of(frame))
            color = oidn.denoise(np.asarray(frame.color, np.float32), albedo, normal)
            part = replace(
                frame, color=color[PART], depth=frame.depth[PART], motion=frame.motion[PART],
                motion_next=half(frame.motion_next, 64), aovs=None, reset=number == NUMBERS[0],
                gbuffer={"base_color": half(albedo, 256), "normal": half(normal, 64)},
            )  # fmt: skip
            files = references.get(number)
            truth = None if files is None else half(read_reference(files, oidn).color, 1024)
            writer.write(compact(part), reference=truth)


def half(array: Array | Float32 | None, steps: int) -> Array:
    """Return the recorded part of an array, in steps of 1 / `steps`."""
    assert array is not None
    rounded: Array = (np.round(np.asarray(array[PART], np.float32) * steps) / steps).astype(np.float16)
    return rounded


main(Path(sys.argv[1]))
