"""Write the frames of a shot as raw float32 planes for `upscale`.

    python examples/cpp_onnxruntime/raw_planes.py SHOT_FOLDER OUT_FOLDER [FRAMES]

The shot must have this package's conventions, like shots of `supersampler import`. FRAMES is the number of
frames to write. upscale.cpp describes the format at its top.
"""

import json
import sys
from pathlib import Path

import numpy as np
from OpenImageIO import ImageBuf

CHANNELS = {"color": ("R", "G", "B"), "depth": ("depth.Z",), "motion": ("motion.X", "motion.Y")}
REACTIVE = {"reactive": ("reactive.Y",)}  # optional

if len(sys.argv) not in (3, 4) or not all(count.isdecimal() and int(count) for count in sys.argv[3:]):
    sys.exit(__doc__)
shot, out = Path(sys.argv[1]), Path(sys.argv[2])
description = json.loads((shot / "shot.json").read_text())
if description["conventions"]:
    sys.exit(f"{shot} has other conventions; convert it: supersampler import {shot} -o CONVERTED")
width, height = description["display_size"]
out.mkdir(parents=True, exist_ok=True)
lines = []
for entry in description["frames"][: int(sys.argv[3]) if len(sys.argv) == 4 else None]:
    image = ImageBuf(str(shot / entry["file"]))
    pixels = np.asarray(image.get_pixels("float"))  # (h, w, channels)
    names = image.spec().channelnames
    stem = Path(entry["file"]).stem
    has_reactive = "reactive.Y" in names
    for buffer, channels in (CHANNELS | REACTIVE if has_reactive else CHANNELS).items():
        planes = np.stack([pixels[..., names.index(channel)] for channel in channels])
        planes.astype("<f4").tofile(out / f"{stem}.{buffer}")
    x, y = (repr(float(np.float32(v))) for v in entry["jitter"])
    sizes = f"{pixels.shape[1]} {pixels.shape[0]} {width} {height}"
    factors = f"{entry.get('exposure') or 0.0!r} {entry.get('pre_exposure', 1.0)!r}"
    lines.append(f"{stem} {sizes} {x} {y} {factors} {int(entry.get('reset', False))} {int(has_reactive)}\n")
(out / "frames.txt").write_text("".join(lines))
