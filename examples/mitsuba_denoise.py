"""Denoise path-traced frames of Mitsuba 3 over time, each with the frames before and after it.

    pip install '.[denoise]' mitsuba
    python examples/mitsuba_denoise.py -o out --samples 4

A camera moves around a Cornell box. Mitsuba's AOV integrator renders colour, albedo, normal and position;
motion is computed from depth and cameras. The frames are written as a shot of EXR files, which
`supersampler denoise out/shot -o out/denoised --samples 4` accepts, too. Prints the PSNR of the middle frame,
after the display transform, against a reference: as rendered, by Open Image Denoise alone, and denoised over
time.
"""

import argparse
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from supersampler import Frame, Shot, denoise_sequence
from supersampler.conventions import camera_motion
from supersampler.denoising.oidn import Oidn
from supersampler.io.display import auto_exposure, decibels, display_transform
from supersampler.io.images import write_exr
from supersampler.io.shot import ShotWriter

mi.set_variant("scalar_rgb")  # slower than the LLVM variants, but runs anywhere

NEAR = 0.1  # depth is NEAR / distance
FIELD_OF_VIEW = 40.0  # degrees, horizontal
UP = np.array([0.0, 1.0, 0.0])
CHANNELS = "albedo:albedo,normal:sh_normal,position:position"


def main() -> None:
    """Render the sequence, denoise it, and print its error."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write")
    parser.add_argument("--samples", type=int, default=4, help="samples per pixel")
    parser.add_argument("--frames", type=int, default=11)
    parser.add_argument("--size", type=int, default=256, help="width and height, pixels")
    parser.add_argument("--reference-samples", type=int, default=1024)
    options = parser.parse_args()
    size, middle = (options.size, options.size), options.frames // 2
    with ShotWriter(options.output / "shot", name="cornell", display_size=size, frame_rate=24.0) as writer:
        for index in range(options.frames):
            writer.write(rendered(index, options.size, options.samples))
    shot = Shot.open(options.output / "shot")
    for index, image in enumerate(denoise_sequence(shot, samples=options.samples)):
        write_exr(options.output / f"{index:04d}.exr", image.astype(np.float16), ["R", "G", "B"])
        if index == middle:
            over_time = image
    truth = np.asarray(rendered(middle, options.size, options.reference_samples, seed=10**6).color)
    frame = shot.read(middle).frame
    color, *guides = (np.asarray(a, np.float32) for a in (frame.color, *(frame.gbuffer or {}).values()))
    with Oidn() as oidn:
        alone = oidn.denoise(color, *oidn.clean_guides(*guides))
    exposure = auto_exposure(truth)
    shown = display_transform(truth, exposure)
    images = {"as rendered": frame.color, "Open Image Denoise": alone, "over time": over_time}
    for name, values in images.items():
        error = np.square(display_transform(np.asarray(values), exposure) - shown, dtype=np.float64)
        print(f"{name}: {decibels(float(error.mean())):.2f} dB")


def camera(index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return origin, direction, and projection @ view of a frame; clip space y points up."""
    angle = np.radians(1.0 * index)
    origin = np.array([3.9 * np.sin(angle), 0.3, 3.9 * np.cos(angle)])
    forward = -origin / np.linalg.norm(origin)
    right = np.cross(forward, UP) / np.linalg.norm(np.cross(forward, UP))
    view = np.eye(4)
    view[:3, :3] = right, np.cross(right, forward), -forward
    view[:3, 3] = -view[:3, :3] @ origin
    slope = 1.0 / np.tan(np.radians(FIELD_OF_VIEW / 2))
    projection = np.diag([slope, slope, 0.0, 0.0])
    projection[2, 3], projection[3, 2] = NEAR, -1.0  # reversed, infinite far: depth is NEAR / distance
    return origin, forward, projection @ view


def rendered(index: int, size: int, samples: int, seed: int = 0) -> Frame:
    """Render a frame with its guides."""
    origin, forward, now = camera(index)
    content: dict[str, Any] = mi.cornell_box()
    content["integrator"] = {"type": "aov", "aovs": CHANNELS, "image": {"type": "path", "max_depth": 6}}
    content["sensor"] = {
        "type": "perspective",
        "fov": FIELD_OF_VIEW,
        "to_world": mi.ScalarTransform4f().look_at(origin.tolist(), [0, 0, 0], UP.tolist()),
        "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
    }
    image = np.array(mi.render(mi.load_dict(content), spp=samples, seed=seed + index), np.float32)
    color, albedo, normal, position = image[..., :3], image[..., -9:-6], image[..., -6:-3], image[..., -3:]
    hit = np.abs(normal).sum(axis=-1) > 0.0
    distance = np.where(hit, (position - origin) @ forward, np.inf)
    depth = (NEAR / np.maximum(distance, NEAR)).astype(np.float32)
    motion = camera_motion(depth, now, camera(max(0, index - 1))[2], near=NEAR)
    return Frame(
        color=np.ascontiguousarray(color),
        depth=depth,
        motion=motion,
        jitter=(0.0, 0.0),
        reset=index == 0,
        gbuffer={"base_color": albedo.clip(0.0, 1.0), "normal": np.ascontiguousarray(normal)},
    )


if __name__ == "__main__":
    main()
