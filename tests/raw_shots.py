"""A small shot in raw files, for hosts of exported shaders, and the images of the GPU backend."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpu_steps import moving
from supersampler import Frame, Model, Upscaler
from supersampler.backends.gpu.device import default_device

DISPLAY = (41, 25)
SIZES = ((20, 12), (20, 12), (21, 13), (17, 11), (17, 11), (20, 12), (20, 12))
RESET, GIVEN, STILL = 4, 2, 6
"""Frames with a reset; with an exposure that is given; with the jitter of the previous frame."""
FORMATS = {"color": ("rgba32float", 4), "depth": ("r32float", 1), "motion": ("rg32float", 2)}


def frames() -> list[Frame]:
    """Frames of changing size, with a reset in between."""
    made = [moving(index, size) for index, size in enumerate(SIZES)]
    made[RESET] = replace(made[RESET], reset=True)
    made[GIVEN] = replace(made[GIVEN], exposure=1.5)
    made[STILL] = replace(made[STILL], jitter=made[STILL - 1].jitter)
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


def wanted_images(method: str) -> list[bytes]:
    """Return the images of the GPU backend, half floats (height, width, RGBA)."""
    device = default_device()
    upscaler = Upscaler(Model.load(method, executor="gpu", device=device), display_size=DISPLAY)
    images = []
    for frame in frames():
        textures = {name: _texture(device, frame, name) for name in FORMATS}
        image: Any = upscaler.step_textures(
            textures, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset
        )
        size = (*DISPLAY, 1)
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
