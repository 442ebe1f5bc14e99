"""Write the frames of a shot as raw float32 planes for `upscale`.

    python examples/cpp_onnxruntime/raw_planes.py SHOT OUT_FOLDER [FRAMES]

SHOT is the name of a shot, or its folder. FRAMES is the number of frames to write. upscale.cpp describes the
format at its top.
"""

import sys
from itertools import islice
from pathlib import Path

import numpy as np

from supersampler import Shot, SupersamplerError

if len(sys.argv) not in (3, 4) or not all(count.isdecimal() and int(count) for count in sys.argv[3:]):
    sys.exit(__doc__)
out, lines = Path(sys.argv[2]), []
try:
    shot = Shot.open(sys.argv[1])
    if shot.display_size is None:
        sys.exit(f"{shot.path} states no display_size")
    out.mkdir(parents=True, exist_ok=True)
    for item in islice(shot, int(sys.argv[3]) if len(sys.argv) == 4 else None):
        frame, stem = item.frame, f"{item.index:04d}"
        if frame.color is None:
            sys.exit(f"frame {item.index} of {shot.path} has no colour")
        images = {"color": frame.color, "depth": frame.depth, "motion": frame.motion}
        if frame.reactive is not None:
            images["reactive"] = frame.reactive
        for buffer, image in images.items():
            np.moveaxis(np.atleast_3d(image), -1, 0).astype("<f4").tofile(out / f"{stem}.{buffer}")
        sizes = *frame.size, *shot.display_size
        factors = *frame.jitter, frame.exposure or 0.0, frame.pre_exposure
        flags = int(frame.reset), int(frame.reactive is not None)
        lines.append(" ".join(map(str, (stem, *sizes, *factors, *flags))) + "\n")
except (SupersamplerError, OSError) as error:
    sys.exit(str(error))
(out / "frames.txt").write_text("".join(lines))
