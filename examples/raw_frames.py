"""Write the frames of a shot as raw float32 files, for hosts in languages that read no EXR files.

    python examples/raw_frames.py plaza out/raw --frames 32

frames.json names the files and has sizes, jitter, exposure and resets. Rows go from the top; colour has four
channels (alpha is 1), depth one, motion two: what textures rgba32float, r32float and rg32float hold.
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
    parser.add_argument("--frames", type=int, default=32)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    shot, frames = Shot.open(options.shot), []
    for item in islice(shot, options.frames):
        frame = item.frame
        if frame.color is None or frame.depth is None:
            raise SystemExit(f"frame {item.index} has no colour or no depth: take a shot that was shaded")
        alpha = np.ones((*frame.color.shape[:2], 1), np.float32)
        pixels = {
            "color": np.concatenate([frame.color, alpha], axis=2),
            "depth": frame.depth,
            "motion": frame.motion,
        }
        files = {name: f"{item.index:04d}.{name}.f32" for name in pixels}
        for name, file in files.items():
            np.asarray(pixels[name], "<f4").tofile(options.output / file)
        frames.append(
            {
                "jitter": frame.jitter,
                "exposure": frame.exposure,
                "reset": frame.reset,
                "size": frame.size,
                **files,
            }
        )
    description = {"display": shot.display_size, "frames": frames}
    (options.output / "frames.json").write_text(json.dumps(description, indent=1))
    print(f"{len(frames)} frames: {options.output}")


if __name__ == "__main__":
    main()
