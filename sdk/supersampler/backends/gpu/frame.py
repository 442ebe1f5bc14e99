"""Inputs of a step: a frame in arrays, or in textures and buffers of the caller; and the parameters."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.gpu import memory as gpu
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Array, Float32, Frame, Size
from supersampler.io.display import usable_exposure
from supersampler.methods.gbuffers import GBUFFERS, arrays_by_name, check_image_names

if TYPE_CHECKING:
    import wgpu

IMAGE_FORMAT = "rgba16float"
PARAMS = 16
"""Number of values in the shader's `Params`."""
SKIPS = 13
"""Index of `skips` among them."""
TEXTURE_CHANNELS = 4
"""Channels of a texture of AOVs."""
CHANNELS = {"color": 3, "depth": 1, "motion": 2, "reactive": 1}
"""Images of a frame that shaders read, and their channels; "reactive" may be missing."""
_KINDS = {"motion": "float", "gbuffer_normal": "float|snorm", "gbuffer_display_normal": "float|snorm"}
"""Kinds of formats for values that others do not hold: pixels of motion, and components with a sign."""
_SAMPLED, _STORED, _COPY_DST, _STORAGE = 4, 8, 8, 128  # WebGPU's usage flags
_COPY_PITCH = 256
"""Rows of a buffer that a texture was copied to begin at multiples of this number of bytes."""
_SAME_DEVICE = "`Model.load(..., executor='gpu', device=device)` runs on the textures' device."


def step_params(
    frame: "Frame | DeviceFrame",
    display: Size,
    previous: Size,
    *,
    has_reactive: bool = False,
    adds_samples: float = 0.0,
    writes_aux: bool = False,
    skip: bool = False,
) -> Float32:
    """Return the shader's `Params`; with auxiliary outputs no tile is skipped.

    `previous` is the size of the previous frame.
    """
    sizes = *frame.size, *display, *previous
    values = *frame.jitter, usable_exposure(frame.exposure) or 0.0
    flags = adds_samples, writes_aux, frame.pre_exposure, has_reactive, skip and not writes_aux
    return np.array([*sizes, *values, *flags, 0.0, 0.0], np.float32)


def frame_memory(names: Collection[str]) -> dict[str, gpu.PixelMemory]:
    """Return the memory of the images that a method reads, by the names that shaders use.

    G-buffers are in textures, because a pass may have no more than eight storage buffers.
    """
    buffers = {
        f"frame_{name}": gpu.PixelBuffer(4 * n, gpu.RENDER) for name, n in CHANNELS.items() if name in names
    }
    textures = {
        f"frame_{name}": gpu.PixelTexture(
            gpu.DISPLAY if place.of_display else gpu.RENDER,
            "r32float" if place.channels == 1 else "rgba16float",
        )
        for name, place in GBUFFERS.items()
        if name in names
    }
    return {**buffers, **textures}


def upload_frame(
    device: "wgpu.GPUDevice", memory: Mapping[str, gpu.Memory], frame: Frame, names: Collection[str]
) -> None:
    """Copy the images of a frame that the method reads to the device."""
    for name, image in arrays_by_name(frame).items():
        if name in names and name in GBUFFERS:
            gpu.write_to(device, memory[f"frame_{name}"], _texels(image))
        elif name in names:
            gpu.write_to(device, memory[f"frame_{name}"], np.asarray(image, np.float32))


def _texels(gbuffer: Array) -> NDArray[np.floating[Any]]:
    """Return a G-buffer in the format of its texture: float32, or vectors as four half floats."""
    if gbuffer.ndim == 2:
        return gbuffer.astype(np.float32)[..., None]
    texels = np.zeros((*gbuffer.shape[:2], 4), np.float16)
    with np.errstate(over="ignore"):
        texels[..., :3] = gbuffer
    return texels


class DeviceAovs(NamedTuple):
    """AOVs of a frame on the device.

    Attributes:
        images: textures of four channels each, or one buffer (h, w, channels).
        channels: channels of all images together.
        targets: where they are written at display size: a texture for each texture, or a buffer; empty:
            nowhere but to the history.
    """

    images: Sequence[Any]
    channels: int
    targets: Sequence[Any] = ()

    def bytes(self, size: Size) -> int:
        """Return the bytes of all channels in a buffer of float32."""
        return 4 * self.channels * size[0] * size[1]


@dataclass(frozen=True, eq=False)
class DeviceFrame:
    """A frame on the GPU.

    Attributes:
        images: textures or buffers by name: "color", "depth", "motion", optionally "reactive"; textures of
            G-buffers.
        size: (width, height).
        jitter: see `Frame`.
        exposure: see `Frame`.
        pre_exposure: see `Frame`.
        aovs: AOVs to blend, if any; then "depth" is among the images.
    """

    images: Mapping[str, Any]
    size: Size
    jitter: tuple[float, float]
    exposure: float | None
    pre_exposure: float = 1.0
    aovs: DeviceAovs | None = None

    @property
    def in_textures(self) -> bool:
        """Whether the images are textures."""
        return is_texture(self.images["color"])


def is_texture(image: object) -> bool:
    """Return whether this is a texture of wgpu."""
    return hasattr(image, "create_view")


def checked_images(
    images: object,
    names: Sequence[str],
    render_size: Size | None,
    display_of: Callable[[Size], Size],
    device: "wgpu.GPUDevice",
) -> tuple[dict[str, Any], Size]:
    """Return the images that a method reads, and the size of the frame.

    `names` are the method's inputs, `display_of` returns the display size for a render size; see
    `Upscaler.step_textures` for `render_size`.

    Raises:
        FrameError: an image is missing, of another device, or has an unknown name or a wrong size, format or
            usage.
    """
    if not isinstance(images, Mapping):
        raise FrameError("images", got=shown(images), want="textures or buffers by name")
    check_image_names("images", images)
    given = {name: images.get(name) for name in (*CHANNELS, *GBUFFERS) if name in names}
    if given.get("reactive") is None:
        given.pop("reactive", None)
    for name, image in given.items():
        is_buffer = hasattr(image, "map_state") and name not in GBUFFERS
        if not is_texture(image) and not is_buffer:
            want = "a wgpu texture" if name in GBUFFERS else "a wgpu texture or buffer"
            hint = "Pass the texture of this view." if hasattr(image, "texture") else ""
            raise FrameError(name, got=shown(image), want=want, hint=hint)
    kinds = {is_texture(image) for name, image in given.items() if name not in GBUFFERS}
    if len(kinds) > 1:
        raise FrameError("images", got="textures and buffers", want="one kind")
    size = tuple(images["color"].size[:2]) if kinds == {True} and render_size is None else render_size
    if size is None:
        raise FrameError("render_size", got=None, want="(width, height) of the buffers")
    for name, image in given.items():
        of_display = name in GBUFFERS and GBUFFERS[name].of_display
        may_be_larger = render_size is not None and not of_display
        extent = display_of(size) if of_display else size
        _check_image(name, image, extent, device, may_be_larger=may_be_larger)
    return given, size


def checked_aovs(
    images: Sequence[Any],
    targets: Sequence[Any],
    render: Size,
    display: Size,
    device: "wgpu.GPUDevice",
    *,
    in_textures: bool,
    may_be_larger: bool,
) -> DeviceAovs | None:
    """Return AOVs and where their blend is written, or None without any; see `Upscaler.step_textures`.

    `may_be_larger`: whether textures of the frame may be larger than it.

    Raises:
        FrameError: an image is of another device, or has a wrong size, format or usage.
        ArgumentError: a target is wrong in the same way, or the numbers of images and targets differ.
    """
    for name, given in (("aovs", images), ("aovs_out", targets)):
        if not isinstance(given, list | tuple) or any(is_texture(one) != in_textures for one in given):
            want = "a list of textures or buffers, as the images of the frame are"
            raise ArgumentError(name, got=shown(given), want=want)
    if len(images) != len(targets) or (len(images) > 1 and not in_textures):
        want = "as many textures in both" if in_textures else "one buffer in both"
        raise ArgumentError("aovs and aovs_out", got=f"{len(images)} and {len(targets)}", want=want)
    if not images:
        return None
    pixel_bytes = 4 * render[0] * render[1]
    channels = len(images) * TEXTURE_CHANNELS if in_textures else max(images[0].size // pixel_bytes, 1)
    for image in images:
        _check_image("aovs", image, render, device, channels, may_be_larger=may_be_larger)
    for target in targets:
        checked_target(target, display, device, "aovs_out", channels)
    return DeviceAovs(images, channels, targets)


def checked_target(
    image: Any, display: Size, device: "wgpu.GPUDevice", name: str = "out", channels: int = 3
) -> Any:
    """Return a texture or buffer that a step may write; a buffer has `channels`.

    Raises:
        ArgumentError: it has another device, size, format or usage.
    """
    if is_texture(image):
        want = f"{IMAGE_FORMAT} {display} with STORAGE_BINDING"
        good = _is_plain(image) and tuple(image.size[:2]) == display and image.usage & _STORED
        good = good and image.format == IMAGE_FORMAT
        got = _texture_text(image)
    else:
        usage = _STORAGE if name == "out" else _COPY_DST
        min_bytes, size = 4 * channels * display[0] * display[1], getattr(image, "size", 0)
        want = f"{min_bytes} bytes with {'STORAGE' if name == 'out' else 'COPY_DST'}"
        good = bool(size >= min_bytes and image.usage & usage)
        got = f"{size} bytes" if good or size else shown(image)
    if not good:
        raise ArgumentError(name, got=got, want=want)
    if device_of(image) is not device:
        raise ArgumentError(name, got="of another device", want="of the Upscaler's", hint=_SAME_DEVICE)
    return image


def check_apart(targets: Sequence[Any], inputs: Sequence[Any]) -> None:
    """Raise ArgumentError if a target is an image that the step reads, or another target."""
    for place, target in enumerate(targets):
        if any(target is other for other in (*inputs, *targets[:place])):
            got, want = "another image of the step, too", "one that the step neither reads nor writes"
            raise ArgumentError("aovs_out" if place else "out", got=got, want=want)


def check_encoder(encoder: object, device: "wgpu.GPUDevice") -> None:
    """Raise ArgumentError unless this is a command encoder of the device."""
    if not hasattr(encoder, "begin_compute_pass"):
        raise ArgumentError("encoder", got=shown(encoder), want="a GPUCommandEncoder of wgpu")
    if device_of(encoder) is not device:
        raise ArgumentError("encoder", got="of another device", want="of the Upscaler's", hint=_SAME_DEVICE)


def device_of(resource: Any) -> Any:
    """Return the device of a texture, buffer or encoder."""
    return resource._device  # wgpu has no public name for it


def _is_plain(texture: Any) -> bool:
    return bool(texture.dimension == "2d" and texture.size[2] == texture.sample_count == 1)


def _texture_text(texture: Any) -> str:
    text = f"{texture.format} {tuple(texture.size[:2])} with usage {texture.usage}"
    kind = f", {texture.dimension}, {texture.size[2]} layers, {texture.sample_count} samples"
    return text if _is_plain(texture) else text + kind


def _float_channels(texture_format: str, kinds: str) -> int:
    """Return the number of channels that shaders read as floats of these kinds; 0 for other formats."""
    names = re.fullmatch(rf"([rgba\d]+)({kinds})", texture_format)
    return len(re.sub(r"\d", "", names[1])) if names else 0


def _check_image(
    name: str,
    image: Any,
    size: Size,
    device: "wgpu.GPUDevice",
    channels: int | None = None,
    *,
    may_be_larger: bool = False,
) -> None:
    """Raise FrameError unless a shader can read this image; `channels` are those of a buffer of AOVs."""
    if is_texture(image):
        least = GBUFFERS[name].channels if name in GBUFFERS else CHANNELS.get(name, 1)
        width, height, _ = image.size
        fits = width >= size[0] and height >= size[1] if may_be_larger else (width, height) == size
        has_channels = _float_channels(image.format, _KINDS.get(name, "u?float|[us]norm(-srgb)?")) >= least
        if not (fits and has_channels and _is_plain(image) and image.usage & _SAMPLED):
            kind = f"{_KINDS[name].replace('|', ' or ')} format" if name in _KINDS else "colour format"
            want = f"a {kind} of {least} or more channels, {size}, one sample, with TEXTURE_BINDING"
            raise FrameError(name, got=_texture_text(image), want=want)
    else:
        min_bytes = 4 * (channels or CHANNELS[name]) * size[0] * size[1]
        if getattr(image, "size", 0) < min_bytes or not image.usage & _STORAGE:
            want = f"at least {min_bytes} bytes with STORAGE: float32, row by row"
            raise FrameError(name, got=f"{getattr(image, 'size', shown(image))} bytes", want=want)
        row = min_bytes // size[1]
        padded = -(-row // _COPY_PITCH) * _COPY_PITCH
        if row < padded and size[1] > 1 and image.size in (padded * size[1], padded * (size[1] - 1) + row):
            got, want = f"{image.size} bytes, rows of {padded}", f"rows of {row} bytes, without padding"
            raise FrameError(name, got=got, want=want)
    if device_of(image) is not device:
        raise FrameError(name, got="of another device", want="of the Upscaler's", hint=_SAME_DEVICE)
