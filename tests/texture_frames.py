"""Frames in textures and buffers of a caller's device, and the pixels of image textures."""

from typing import Any

import numpy as np

from supersampler import Frame

FORMATS = {
    "color": ("rgba32float", 4),
    "depth": ("r32float", 1),
    "motion": ("rg32float", 2),
    "reactive": ("r32float", 1),
}
COPY_SRC, COPY_DST, SAMPLED, STORED, RENDERED, STORAGE = 1, 2, 4, 8, 16, 128
"""Usage flags of WebGPU: of textures, and of buffers."""


def texture_of(device: Any, image: Any, texel: str, channels: int) -> Any:
    height, width = image.shape[:2]
    values = np.ones((height, width, channels), np.float32)
    values[..., : np.atleast_3d(image).shape[2]] = np.atleast_3d(image)
    texture = device.create_texture(size=(width, height, 1), format=texel, usage=SAMPLED | COPY_DST)
    layout = {"bytes_per_row": values.strides[0], "rows_per_image": height}
    device.queue.write_texture({"texture": texture}, values, layout, (width, height, 1))
    return texture


def textures_of(device: Any, frame: Frame) -> dict[str, Any]:
    given = {name: getattr(frame, name) for name in FORMATS}
    return {name: texture_of(device, a, *FORMATS[name]) for name, a in given.items() if a is not None}


def buffer_of(device: Any, image: Any) -> Any:
    return device.create_buffer_with_data(data=np.ascontiguousarray(image, np.float32), usage=STORAGE)


def buffers_of(device: Any, frame: Frame) -> dict[str, Any]:
    given = {name: getattr(frame, name) for name in FORMATS}
    return {name: buffer_of(device, image) for name, image in given.items() if image is not None}


def pixels_of(device: Any, texture: Any, channels: int = 3) -> np.ndarray[Any, Any]:
    width, height = texture.size[:2]
    data = device.queue.read_texture({"texture": texture}, {"bytes_per_row": 8 * width}, (width, height, 1))
    return np.frombuffer(data, np.float16).reshape(height, width, 4)[..., :channels].astype(np.float32)
