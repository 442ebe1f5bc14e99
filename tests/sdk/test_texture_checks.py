"""Tests of the checks of colour that textures tell: a missing mip bias, and colour as it is displayed."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler.conventions import halton_jitter, mip_bias
from supersampler.conventions.srgb import srgb_encoded
from supersampler.errors import FrameWarning
from supersampler.frame import Frame
from supersampler.io.shot import Shot
from supersampler.validation import FrameChecker
from supersampler_model.data.product_shot import Plaza
from supersampler_model.data.renderer import renderer as rendering
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, make_sequence
from supersampler_model.data.specs import SequenceSpec

SIZE = (128, 72)
TEXELS = 3  # log2 of the base level's texels in a render pixel
VELOCITY = (1.3, 0.4)
RATIOS = (1.5, 2.0, 3.0)


def told(frames: list[Frame], ratio: float) -> list[str]:
    checker, (width, height) = FrameChecker(), frames[0].size
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        for frame in frames:
            checker.check(frame, (round(ratio * width), round(ratio * height)))
    return [str(each.message) for each in caught]


def texture(seed: int, slope: float) -> NDArray[np.float64]:
    """Noise with a spectrum of 1 / frequency^slope, as of stone or wood."""
    noise = np.random.default_rng(seed).standard_normal((1024, 1024))
    frequency = np.hypot(np.fft.fftfreq(1024)[:, None], np.fft.rfftfreq(1024)[None])
    frequency[0, 0] = 1.0
    values = np.fft.irfft2(np.fft.rfft2(noise) / frequency**slope, s=noise.shape)
    found: NDArray[np.float64] = np.exp(0.5 * values / values.std())
    return found


def mip(base: NDArray[np.float64], level: int, x: Any, y: Any) -> NDArray[np.float64]:
    """A level at (x, y) in texels of the base level, by bilinear interpolation; the texture repeats."""
    count = len(base) >> level
    texels = base.reshape(count, 1 << level, count, 1 << level).mean(axis=(1, 3))
    x, y = x / 2**level - 0.5, y / 2**level - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = x - column, y - row

    def texel(right: int, down: int) -> NDArray[np.float64]:
        values: NDArray[np.float64] = texels[(row + down) % count, (column + right) % count]
        return values

    above = texel(0, 0) * (1 - u) + texel(1, 0) * u
    below: NDArray[np.float64] = texel(0, 1) * (1 - u) + texel(1, 1) * u
    found: NDArray[np.float64] = above * (1 - v) + below * v
    return found


def plane(ratio: float, bias: float, *, seed: int = 0, slope: float = 1.0) -> list[Frame]:
    """Frames of a textured plane that moves, by trilinear filtering with this bias."""
    base, level = texture(seed, slope), TEXELS + bias
    lower = int(np.floor(level))
    frames = []
    for index in range(3):
        jitter = halton_jitter(index, ratio)
        x, y = (
            (grid + 0.5 + offset + speed * index) * 2**TEXELS
            for grid, offset, speed in zip(
                np.mgrid[: SIZE[1], : SIZE[0]][::-1], jitter, VELOCITY, strict=True
            )
        )
        part = level - lower
        light = (1 - part) * mip(base, lower, x, y) + part * mip(base, lower + 1, x, y)
        frames.append(
            Frame(
                color=np.repeat(light[..., None], 3, axis=2).astype(np.float32),
                depth=np.full(light.shape, 0.1, np.float32),
                motion=np.broadcast_to(np.array(VELOCITY, np.float32), (*light.shape, 2)).copy(),
                jitter=jitter,
                reset=index == 0,
            )
        )
    return frames


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("ratio", [2.0, 3.0])
def test_a_missing_mip_bias_is_hinted_at_with_its_value(ratio: float, seed: int) -> None:
    [message] = told(plane(ratio, 0.0, seed=seed), ratio)
    assert f"mip_bias({ratio:g}, 'log2') = {mip_bias(ratio, 'log2'):.2f}" in message


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("style", ["fsr", "log2"])
def test_the_right_mip_bias_is_fine(style: Any, ratio: float, seed: int) -> None:
    assert told(plane(ratio, mip_bias(ratio, style), seed=seed), ratio) == []


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize(("bias", "slope"), [(2.0, 1.0), (3.0, 1.0), (-1.0, 2.0), (0.0, 3.0)])
def test_magnified_and_smooth_textures_are_fine(bias: float, slope: float, ratio: float) -> None:
    """Levels that are too coarse for any pixel are those of textures seen from close by."""
    assert told(plane(ratio, bias, slope=slope), ratio) == []


def test_at_a_ratio_of_one_textures_need_no_bias() -> None:
    assert told(plane(1.0, 0.0), 1.0) == []


def rendered(family: str, ratio: float) -> list[Frame]:
    """Frames of a scene of training or test shots, with the renderer's own mip bias."""
    display = (320, 180)
    renderer = Renderer(display)
    sequence = (
        Plaza() if family == "plaza" else make_sequence(SequenceSpec(family=family, seed=100, frames=5))
    )
    frames = []
    for index in range(3):
        jitter = halton_jitter(index, ratio)
        size = (int(display[0] / ratio), int(display[1] / ratio))
        color, surfaces = renderer.frame(sequence.scene(index), size, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        frames.append(
            Frame(color=color, depth=surfaces.depth, motion=motion, jitter=jitter, reset=index == 0)
        )
    return frames


@pytest.mark.parametrize("family", ["plaza", *TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES])
def test_rendered_scenes_pass_without_a_word(family: str) -> None:
    assert told(rendered(family, 2.0), 2.0) == []


def test_a_rendered_scene_without_mip_bias_is_hinted_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "mip_bias", lambda *_: 0.0)
    assert any("mip_bias(1.5, 'log2')" in message for message in told(rendered("station", 1.5), 1.5))


def tone_mapped(color: Any) -> Any:
    return srgb_encoded(color / (1 + color.max(axis=2, keepdims=True)))


def changed(change: Callable[[Any], Any]) -> list[str]:
    frame = Shot.open("plaza").read(12).frame
    assert frame.color is not None
    color = change(frame.color.astype(np.float32)).astype(np.float32)
    return told([Frame(color=color, depth=frame.depth, motion=frame.motion, jitter=frame.jitter)], 2.0)


@pytest.mark.parametrize("scale", [1, 255])
def test_colour_as_it_is_displayed_is_hinted_at(scale: int) -> None:
    [message] = changed(lambda color: scale * tone_mapped(color))
    assert f"frame.color is never above {scale}, and as bright as a displayed image" in message
    assert "Conventions(srgb=True)" in message
    assert ("Divide by 255" in message) == (scale == 255)


@pytest.mark.parametrize("most", [0.5, 1.0, 254.0, 1e4])
def test_linear_colour_of_any_scale_is_fine(most: float) -> None:
    assert changed(lambda color: most * color / color.max()) == []
