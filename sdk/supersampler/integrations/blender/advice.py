"""Compare ways to render a Cycles scene on a few small frames: plain, denoised over time, upscaled.

There is no reference. Instead, one frame is rendered again with another seed and is not denoised: it is the
true image plus noise of mean 0, independent of all results. The mean squared difference of a result from it
is therefore the result's own error plus the variance of that noise, which is the same for all results. The
variance is estimated from the difference of the two noisy images, as proportional to 1 / samples.

The second render has more samples, because at the same small number the errors of two seeds correlate in
Cycles (0.06 at 4 samples per pixel), which favours a plain frame.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from supersampler.denoising import denoise_sequence
from supersampler.denoising.oidn import has_oidn
from supersampler.denoising.sequence import PerFrame
from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.integrations.blender.render import Rendering, RenderRequest, rendering
from supersampler.io.display import luminance
from supersampler.io.shot import Shot
from supersampler.io.shot.blender import RenderedScene
from supersampler.upscaler import Upscaler

FRAMES = 5
"""Frames of each way. Temporal denoising is compared at the middle frame, upscaling at the last one."""
PART = 0.5
"""Fraction of the width and height at which frames are tried."""
_SCALE = 2.0
_MORE = 4  # samples of the second render, divided by those of the frames
_BLOCK = 8  # side of the blocks of pixels whose errors are taken as independent
_DARK = 0.01  # luminance below which errors are not relative
_SLOWER = 1.1  # largest ratio of times at which two ways count as equally fast


@dataclass(frozen=True, kw_only=True)
class Way:
    """Result of trying one way to render.

    Attributes:
        name: "plain", "temporal" or "upscaled".
        seconds: estimated wall time of a full-size frame, proportional to the number of pixels.
        error: estimated root mean square of the relative error of light.
        image: (h, w, 3) the compared frame, linear RGB.
    """

    name: str
    seconds: float
    error: float
    image: Float32


@dataclass(frozen=True, kw_only=True)
class Advice:
    """Comparison of the ways to render.

    Attributes:
        scene: the scene, as rendered for the trial.
        ways: plain, temporal, upscaled.
        best: of the ways `alike`, the fastest; of equally fast ones, the one with the smallest error.
        alike: names of the ways whose errors are not significantly larger than the smallest error.
        frame: number of the compared frame.
    """

    scene: RenderedScene
    ways: tuple[Way, ...]
    best: Way
    alike: tuple[str, ...]
    frame: int


def advise(
    request: RenderRequest, folder: Path, *, overwrite: bool = False, note: Callable[[str], None]
) -> Advice:
    """Render FRAMES frames at PART of the size in each way, and compare them.

    Args:
        request: the scene, without a scale.
        folder: folder for the renders; complete ones are used again.
        overwrite: whether to render all of them again.
        note: called with each message about a setting that differs from the file's.

    Raises:
        ArgumentError: the request has a scale, or Blender was not found.
        ShotError: the scene cannot be rendered, its engine is not Cycles, or it samples adaptively and the
            request has no number of samples.
    """
    if request.scale is not None or request.denoise not in (None, "temporal"):
        raise ArgumentError("--advise", got="given with --scale or --denoise", want="neither: it tries both")
    numbers, size = request.frames, request.display_size
    if numbers is not None:
        first = max(numbers[0], (numbers[0] + numbers[1] - FRAMES + 1) // 2)
        numbers = first, min(first + FRAMES - 1, numbers[1])
    if size is not None:
        size = round(size[0] * PART), round(size[1] * PART)
    full = replace(request, denoise="temporal", frames=numbers, display_size=size, part=PART, most=FRAMES)
    with rendering(full, folder / "full", overwrite=overwrite, note=note) as render:
        shot = render.shot.with_noise() if has_oidn() else render.shot
        scene, frames = render.scene, [item.frame for item in shot]
        middle, rendered = len(frames) // 2, _seconds(render)
        number = render.shot.first_number + middle
        plain, first_noisy = (_color(each, middle) for each in (render.shot, render.shot.with_noise()))
    began = time.perf_counter()
    per_frame: PerFrame = "none" if shot.is_denoised else "oidn"
    temporal = list(denoise_sequence(frames, per_frame=per_frame, samples=scene.samples))[middle]
    filtered = (time.perf_counter() - began) / len(frames)
    again = replace(full, frames=(number, number), seed=1, samples=_MORE * (scene.samples or 1))
    with rendering(again, folder / "again", overwrite=overwrite, note=lambda _: None) as render:
        noisy = first_noisy, _color(render.shot.with_noise(), 0)
    upscaled, small = _upscaled(full, folder, scene, number, overwrite=overwrite)
    times = {"plain": rendered, "temporal": rendered + filtered, "upscaled": small}
    images = {"plain": plain, "temporal": temporal, "upscaled": upscaled}
    weight = np.reciprocal(np.square(luminance(plain)) + np.float32(_DARK**2))
    squares = {name: _relative_squares(image, noisy[1], weight) for name, image in images.items()}
    variance = float(_relative_squares(noisy[0], noisy[1], weight).mean()) / (_MORE + 1)
    errors = {name: max(0.0, float(found.mean()) - variance) ** 0.5 for name, found in squares.items()}
    ways = tuple(
        Way(name=name, seconds=times[name] / PART**2, error=errors[name], image=image)
        for name, image in images.items()
    )
    least = min(ways, key=lambda way: way.error)
    alike = [way for way in ways if _are_alike(squares[way.name], squares[least.name])]
    limit = _SLOWER * min(way.seconds for way in alike)
    best = min((way for way in alike if way.seconds <= limit), key=lambda way: way.error)
    return Advice(scene=scene, ways=ways, best=best, alike=tuple(way.name for way in alike), frame=number)


def _upscaled(
    full: RenderRequest, folder: Path, scene: RenderedScene, number: int, *, overwrite: bool
) -> tuple[Float32, float]:
    """Return an upscaled frame with the same number of samples as a frame of `full`, and its seconds."""
    request = replace(
        full,
        denoise="frame",
        scale=_SCALE,
        samples=round((scene.samples or 1) * _SCALE**2),
        frames=(max(0, number - FRAMES + 1), number),
        display_size=scene.display_size,
    )
    with (
        rendering(request, folder / "small", overwrite=overwrite, note=lambda _: None) as render,
        Upscaler(display_size=scene.display_size, validate="off") as upscaler,
    ):
        for item in render.shot:
            image = upscaler.step(item.frame)
        seconds = upscaler.stats.seconds / upscaler.stats.frames
        return np.asarray(image, np.float32), _seconds(render) + seconds


def _seconds(render: Rendering) -> float:
    """Return the shortest wall time of a frame; the first frames also load the scene and kernels."""
    return min(camera.seconds for camera in render.cameras())


def _color(shot: Shot, index: int) -> Float32:
    """Return the colour of a frame, (h, w, 3)."""
    return np.asarray(shot.read(index).frame.color, np.float32)


def _relative_squares(image: Float32, other: Float32, weight: Float32) -> Float32:
    """Return the mean weighted squared difference of each block of pixels, flat."""
    squares = np.square(image - other).mean(axis=-1) * weight
    height, width = (side // _BLOCK * _BLOCK for side in squares.shape)
    blocks = squares[:height, :width].reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
    means: Float32 = blocks.mean(axis=(1, 3)).ravel()
    return means


def _are_alike(squares: Float32, least: Float32) -> bool:
    """Return whether the mean of the differences is at most two standard errors above 0."""
    difference = squares - least
    return bool(difference.mean() <= 2.0 * difference.std() / np.sqrt(difference.size))
