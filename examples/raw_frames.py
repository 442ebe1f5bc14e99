"""Write the frames of a shot as raw float32 files, for hosts that cannot read EXR files.

    python examples/raw_frames.py plaza out/raw

frames.json lists files, sizes, jitter, exposure and resets. Rows start at the top. Colour has four channels
(alpha is 1), depth one and motion two, like textures of rgba32float, r32float and rg32float.
"""

import argparse
import json
from itertools import islice
from pathlib import Path

import numpy as np

from supersampler import Shot


def main() -> None:
    """Write the files."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("shot", help="name of a shot, or its folder")
    parser.add_argument("output", type=Path, help="folder to write to")
    parser.add_argument("--frames", type=int, help="number of frames; all if not given")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    shot, frames = Shot.open(options.shot), []
    for item in islice(shot, options.frames):
        frame = item.frame
        if frame.color is None or frame.depth is None:
            raise SystemExit(f"frame {item.index} has no colour or no depth")
        alpha = np.ones((*frame.color.shape[:2], 1), np.float32)
        color = np.concatenate([frame.color, alpha], axis=2)
        pixels = {"color": color, "depth": frame.depth, "motion": frame.motion}
        files = {name: f"{item.index:04d}.{name}.f32" for name in pixels}
        for name, file in files.items():
            np.asarray(pixels[name], "<f4").tofile(options.output / file)
        values = {name: getattr(frame, name) for name in ("jitter", "exposure", "reset", "size")}
        frames.append({**values, **files})
    description = {"display": shot.display_size, "frames": frames}
    (options.output / "frames.json").write_text(json.dumps(description, indent=1))
    print(f"{len(frames)} frames: {options.output}")


if __name__ == "__main__":
    main()
