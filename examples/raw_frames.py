"""Write the frames of a shot as raw float32 files, for hosts that cannot read EXR files.

    python examples/raw_frames.py plaza out/raw

frames.json lists files, sizes, jitter, exposure, pre-exposure and resets. Rows start at the top. Depth and
reactive mask have one channel and motion two, like textures of r32float and rg32float; all others have four,
like rgba32float (colour and G-buffers with an alpha of 1). Four channels of AOVs are one image: aovs0, aovs1
and so on; the last one is filled with zeros.
"""

import argparse
import json
from itertools import islice
from pathlib import Path

import numpy as np

from supersampler import Frame, Shot, SupersamplerError

VALUES = ("jitter", "exposure", "pre_exposure", "reset", "size")
"""Attributes of a frame in frames.json."""


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("shot", help="name of a shot, or its folder")
    parser.add_argument("output", type=Path, help="folder to write to")
    parser.add_argument("--frames", type=int, help="number of frames; all if not given")
    options = parser.parse_args()
    if options.frames is not None and options.frames < 1:
        parser.error(f"--frames is {options.frames}; want at least 1")
    try:
        write(options)
    except (SupersamplerError, OSError) as error:
        raise SystemExit(str(error)) from error


def write(options: argparse.Namespace) -> None:
    """Write the frames and frames.json."""
    shot, frames = Shot.open(options.shot), []
    options.output.mkdir(parents=True, exist_ok=True)
    for item in islice(shot, options.frames):
        frame = item.frame
        if frame.color is None or frame.depth is None:
            raise SystemExit(f"frame {item.index} has no colour or no depth")
        pixels = images_of(frame)
        files = {name: f"{item.index:04d}.{name}.f32" for name in pixels}
        for name, file in files.items():
            np.asarray(pixels[name], "<f4").tofile(options.output / file)
        values = {name: getattr(frame, name) for name in VALUES}
        frames.append({**values, **files})
    description = {"display": shot.display_size, "frames": frames}
    (options.output / "frames.json").write_text(json.dumps(description, indent=1))
    print(f"{len(frames)} frames: {options.output}")


def images_of(frame: Frame) -> dict[str, np.ndarray]:
    """Return the images of a frame, by the names of frames.json."""
    found = {name: getattr(frame, name) for name in ("color", "depth", "motion", "reactive")}
    for group in ("gbuffer", "gbuffer_display"):
        found |= {f"{group}_{name}": image for name, image in (getattr(frame, group) or {}).items()}
    if frame.aovs is not None:
        channels = frame.aovs.shape[2]
        aovs = np.pad(frame.aovs, ((0, 0), (0, 0), (0, -channels % 4)))
        found |= {f"aovs{start // 4}": aovs[..., start : start + 4] for start in range(0, channels, 4)}
    return {name: texels(image) for name, image in found.items() if image is not None}


def texels(image: np.ndarray) -> np.ndarray:
    """Return an image with one, two or four channels; those that are added are 1."""
    image = np.atleast_3d(image)
    if image.shape[2] == 3:
        image = np.pad(image, ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    return image


if __name__ == "__main__":
    main()
