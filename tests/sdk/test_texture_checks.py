"""Tests of the check of colour as it is displayed."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from supersampler.conventions import halton_jitter
from supersampler.conventions.encodings import srgb_encoded
from supersampler.errors import FrameWarning
from supersampler.frame import Frame
from supersampler.io.shot import Shot
from supersampler.validation import FrameChecker
from supersampler_model.data.product_shot import Plaza
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES, make_sequence
from supersampler_model.data.specs import SequenceSpec


def told(frames: list[Frame], ratio: float) -> list[str]:
    checker, (width, height) = FrameChecker(), frames[0].size
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        for frame in frames:
            checker.check(frame, (round(ratio * width), round(ratio * height)))
    return [str(each.message) for each in caught]


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
