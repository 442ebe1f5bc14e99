"""A small shot in raw files, for hosts of exported shaders, and the images of the GPU backend."""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpu_steps import moving
from noise import Size
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.gpu.device import default_device

DISPLAY = (41, 25)
SIZES = ((20, 12), (20, 12), (27, 17), (21, 13), (21, 13), *((20, 12),) * 12)
RESET, GIVEN, STILL = 4, 2, 6
"""Frames with a reset; with an exposure that is given; from which on nothing moves."""
FORMATS = {"color": ("rgba32float", 4), "depth": ("r32float", 1), "motion": ("rg32float", 2)}


def frames() -> list[Frame]:
    """Frames of changing size, with a reset in between; at the end each jitter comes twice."""
    made = [moving(min(index, STILL), size) for index, size in enumerate(SIZES)]
    made[RESET] = replace(made[RESET], reset=True)
    made[GIVEN] = replace(made[GIVEN], exposure=1.5)
    for index in range(STILL, len(made)):
        jitter, motion = halton_jitter(index // 2, 2.0), np.zeros_like(made[index].motion)
        made[index] = replace(made[index], jitter=jitter, motion=motion)
    return made


def write_raw(folder: Path) -> None:
    """Write the shot as examples/raw_frames.py does."""
    folder.mkdir()
    described = []
    for index, frame in enumerate(frames()):
        files = {name: f"{index}.{name}" for name in FORMATS}
        for name, file in files.items():
            texels(frame, name).tofile(folder / file)
        rest = {"jitter": frame.jitter, "exposure": frame.exposure, "reset": frame.reset, "size": frame.size}
        described.append({**rest, **files})
    (folder / "frames.json").write_text(json.dumps({"display": DISPLAY, "frames": described}))


def texels(frame: Frame, name: str) -> NDArray[np.float32]:
    """Return an image of a frame as a texture of FORMATS holds it."""
    image = np.atleast_3d(getattr(frame, name))
    values = np.ones((*image.shape[:2], FORMATS[name][1]), np.float32)
    values[..., : image.shape[2]] = image
    return values


def wanted_images(method: str, shot: Sequence[Frame] = (), display: Size = DISPLAY) -> list[bytes]:
    """Return the images of the GPU backend, half floats (height, width, RGBA); of `frames` without a shot."""
    device = default_device()
    upscaler = Upscaler(Model.load(method, executor="gpu", device=device), display_size=display)
    images = []
    for frame in shot or frames():
        textures = {name: _texture(device, frame, name) for name in FORMATS}
        image: Any = upscaler.step_textures(
            textures, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset
        )
        size = (*display, 1)
        images.append(
            bytes(device.queue.read_texture({"texture": image}, {"bytes_per_row": 8 * size[0]}, size))
        )
    return images


def _texture(device: Any, frame: Frame, name: str) -> Any:
    texel, channels = FORMATS[name]
    values, size = texels(frame, name), (*frame.size, 1)
    texture = device.create_texture(size=size, format=texel, usage=4 | 2)  # sampled, written by a copy
    layout = {"bytes_per_row": 4 * channels * size[0], "rows_per_image": size[1]}
    device.queue.write_texture({"texture": texture}, values, layout, size)
    return texture


def read_images(folder: Path) -> list[bytes]:
    """Return the images that a host wrote, in order."""
    return [file.read_bytes() for file in sorted(folder.glob("*.rgba16f"))]


def difference(one: bytes, other: bytes) -> float:
    """Return the mean difference of two images, each in [0, 1) after a tone curve."""
    toned = [v / (1.0 + v) for v in (np.frombuffer(i, np.float16).astype(np.float32) for i in (one, other))]
    return float(np.abs(toned[0] - toned[1]).mean())


if (
    __name__ == "__main__"
):  # python raw_shots.py METHOD FOLDER: the images, for the adapter of this environment
    method, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir()
    for index, image in enumerate(wanted_images(method)):
        (folder / f"{index:04d}.rgba16f").write_bytes(image)
