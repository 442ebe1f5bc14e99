"""A small shot in raw files, for hosts of exported shaders, and the images of the GPU backend."""

import json
import runpy
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpu_steps import moving, with_aovs
from noise import Size
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.gpu.device import default_device
from texture_frames import texture_of

DISPLAY = (41, 25)
SIZES = ((20, 12), (20, 12), (27, 17), (21, 13), (21, 13), *((20, 12),) * 12)
RESET, GIVEN, MASKED, STILL = 4, 2, 3, 6
"""Frames with a reset; with an exposure that is given; with a reactive mask; from which on nothing moves."""
PRE_EXPOSED = {2: 4.0, 3: 0.25, 9: 2.0}
"""Factors of the colour, by frame."""
FORMATS = {1: "r32float", 2: "rg32float", 4: "rgba32float"}
AOVS = 6
"""Channels; a host has them in two textures, of which the last two channels are zeros."""
RAW = runpy.run_path(str(Path(__file__).parents[1] / "examples" / "raw_frames.py"))
"""The example that writes such files."""


def frames() -> list[Frame]:
    """Frames of changing size, with a reset in between; at the end each jitter comes twice."""
    made = [moving(min(index, STILL), size) for index, size in enumerate(SIZES)]
    made[RESET] = replace(made[RESET], reset=True)
    made[GIVEN] = replace(made[GIVEN], exposure=1.5)
    mask = np.linspace(0.0, 1.0, made[MASKED].depth.size, dtype=np.float32).reshape(made[MASKED].depth.shape)
    made[MASKED] = replace(made[MASKED], reactive=mask)
    for index, factor in PRE_EXPOSED.items():
        color = made[index].color
        assert color is not None
        made[index] = replace(made[index], color=color * np.float32(factor), pre_exposure=factor)
    for index in range(STILL, len(made)):
        jitter, motion = halton_jitter(index // 2, 2.0), np.zeros_like(made[index].motion)
        made[index] = replace(made[index], jitter=jitter, motion=motion)
    return [with_buffers(frame, index) for index, frame in enumerate(made)]


def with_buffers(frame: Frame, index: int) -> Frame:
    """Return the frame with random G-buffers and AOVs, some of them missing samples."""
    random = np.random.default_rng(min(index, STILL))

    def image(size: Size, channels: int) -> NDArray[np.float32]:
        return random.random((*size[::-1], channels), np.float32)

    display = {
        "base_color": image(DISPLAY, 3),
        "normal": image(DISPLAY, 3),
        "depth": image(DISPLAY, 1)[..., 0],
    }
    render = {"base_color": image(frame.size, 3), "normal": image(frame.size, 3)}
    frame = with_aovs(frame, min(index, STILL), AOVS)
    return replace(frame, gbuffer=render, gbuffer_display=display)


def write_raw(folder: Path) -> None:
    folder.mkdir()
    described = []
    for index, frame in enumerate(frames()):
        images = RAW["images_of"](frame)
        files = {name: f"{index}.{name}" for name in images}
        for name, file in files.items():
            np.asarray(images[name], np.float32).tofile(folder / file)
        described.append({**{name: getattr(frame, name) for name in RAW["VALUES"]}, **files})
    (folder / "frames.json").write_text(json.dumps({"display": DISPLAY, "frames": described}))


def wanted_images(
    method: str, shot: Sequence[Frame] = (), display: Size = DISPLAY, *, aovs: int = 0
) -> dict[str, bytes]:
    """Return what a host writes, by file name: half floats (height, width, RGBA) of the GPU backend.

    `shot`: frames other than `frames`. `aovs`: number of textures of AOVs that are blended.
    """
    device = default_device()
    upscaler = Upscaler(Model.load(method, executor="gpu", device=device), display_size=display)
    inputs, size, images = [one.name for one in upscaler.model.info.inputs], (*display, 1), {}
    names = ["rgba16f", *(f"aovs{i}.rgba16f" for i in range(aovs))]
    for index, frame in enumerate(shot or frames()):
        textures = {
            name: texture_of(device, image, FORMATS[image.shape[2]], image.shape[2])
            for name, image in RAW["images_of"](frame).items()
        }
        written = [device.create_texture(size=size, format="rgba16float", usage=8 | 1) for _ in range(aovs)]
        given: Any = {
            name: texture for name, texture in textures.items() if name in inputs or name == "depth"
        }
        image: Any = upscaler.step_textures(
            given, jitter=frame.jitter, exposure=frame.exposure, pre_exposure=frame.pre_exposure,
            reset=frame.reset, aovs=[textures[f"aovs{i}"] for i in range(aovs)], aovs_out=written,
        )  # fmt: skip
        for name, texture in zip(names, [image, *written], strict=True):
            pixels = device.queue.read_texture({"texture": texture}, {"bytes_per_row": 8 * size[0]}, size)
            images[f"{index:04d}.{name}"] = bytes(pixels)
    return images


def read_images(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.glob("*.rgba16f")}


if __name__ == "__main__":  # python raw_shots.py METHOD FOLDER AOVS: the images, for this adapter
    method, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir()
    for name, image in wanted_images(method, aovs=int(sys.argv[3])).items():
        (folder / name).write_bytes(image)
