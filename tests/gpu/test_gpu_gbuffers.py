"""`gbuffer-fast` on the GPU has the images of the CPU backend."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gbuffer_method import textured as surfaces
from gpu_steps import make
from noise import Size, noise
from supersampler import Frame, FrameError, StepResult, halton_jitter
from supersampler.frame import Array
from supersampler.io.display import display_transform
from supersampler.methods.gbuffer_fast.spec import GBUFFERS_READ
from supersampler.methods.gbuffers import GBUFFERS
from texture_frames import pixels_of, texture_of, textures_of

METHOD = "gbuffer-fast"
SIZES: list[tuple[Size, Size]] = [
    ((1, 1), (1, 1)),
    ((2, 3), (3, 5)),
    ((17, 9), (17, 9)),
    ((17, 9), (33, 18)),
    ((9, 21), (27, 61)),
    ((11, 7), (44, 28)),
]


def frame_at(index: int, render: Size, display: Size, **fields: Any) -> Frame:
    """A frame of random light on surfaces that move; some samples are missing."""
    plain = noise(index, render, exposure=1.0)
    sampled = surfaces(render, plain.jitter, 0.01 * index)
    shown = surfaces(display, (0.0, 0.0), 0.01 * index)
    color = np.asarray(plain.color) * sampled["base_color"]
    if index % 3 == 2:
        color[np.random.default_rng(index).random(color.shape[:2]) < 0.1] = np.nan
    given: dict[str, Any] = {"color": color, "depth": sampled.pop("depth"), "gbuffer": sampled}
    return replace(plain, **{**given, "gbuffer_display": shown, **fields})


def spoiled(buffer: Array, random: np.random.Generator) -> Array:
    """Return a copy with invalid values here and there."""
    values = buffer.copy()
    for value in (np.nan, np.inf, -np.inf, 1e30, -2.0, 1.5):
        values[random.random(values.shape) < 0.02] = value
    return values


def with_invalid_values(frame: Frame, index: int) -> Frame:
    random, groups = np.random.default_rng(index), (frame.gbuffer or {}, frame.gbuffer_display or {})
    render, display = ({name: spoiled(buffer, random) for name, buffer in g.items()} for g in groups)
    return replace(frame, gbuffer=render, gbuffer_display=display)


def with_mask_and_exposures(frame: Frame, index: int) -> Frame:
    """The exposure is measured."""
    color = np.asarray(frame.color) * np.float32(1.7**index)
    mask = np.random.default_rng(index).random(color.shape[:2], np.float32).round(1)
    return replace(frame, color=color, pre_exposure=1.7**index, exposure=None, reactive=mask)


@pytest.mark.parametrize(
    ("sizes", "display", "change"),
    [
        *(([render] * 6, display, lambda frame, _: frame) for render, display in SIZES),
        ([SIZES[3][0]] * 4, SIZES[3][1], with_invalid_values),
        ([SIZES[3][0]] * 6, SIZES[3][1], with_mask_and_exposures),
        ([(20, 12), (20, 12), (31, 19), (40, 24)], (40, 24), lambda frame, _: frame),
        (
            [(20, 12), (14, 9)],
            (40, 24),
            lambda frame, index: replace(frame, gbuffer=None) if index else frame,
        ),
    ],
)
def test_images_are_those_of_the_cpu_backend_borders_included(
    sizes: list[Size], display: Size, change: Callable[[Frame, int], Frame]
) -> None:
    """Mean, 99.9 % quantile and largest difference of display values."""
    ours, theirs = (make(METHOD, executor, display=display) for executor in ("gpu", "cpu"))
    found = []
    for index, size in enumerate(sizes):
        frame = change(frame_at(index, size, display), index)
        images = [display_transform(each.step(frame) / frame.pre_exposure) for each in (ours, theirs)]
        assert np.isfinite(images[0]).all()
        found.append(np.abs(images[0] - images[1]).ravel())
    differences = np.concatenate(found)
    assert differences.mean() < 2e-3
    assert np.quantile(differences, 0.999) < 0.02
    assert differences.max() < 0.06


def test_g_buffers_have_an_effect() -> None:
    frames = [frame_at(index, *SIZES[3]) for index in range(3)]
    darker = [
        replace(frame, gbuffer_display={name: 0.5 * buffer for name, buffer in buffers.items()})
        for frame, buffers in ((frame, frame.gbuffer_display or {}) for frame in frames)
    ]
    images = [make(METHOD, display=SIZES[3][1]).step(given[0]) for given in (frames, darker)]
    assert np.abs(images[0] - images[1]).mean() > 1e-2


def still(index: int, render: Size, display: Size) -> Frame:
    """A static scene, sampled with jitter; all of it moves in frames 3 and 4, a corner in frame 80."""
    jitter = halton_jitter(index % 32, 2.0)
    place = (np.arange(render[0]) + jitter[0])[None] + (np.arange(render[1]) + jitter[1])[:, None]
    color = np.repeat((0.4 + 0.3 * np.sin(0.8 * place))[..., None], 3, -1).astype(np.float32)
    motion = np.zeros((*render[::-1], 2), np.float32)
    motion[: render[1] if index in (3, 4) else 3, : render[0] if index in (3, 4) else 3] = index in (3, 4, 80)
    seen = surfaces(render, jitter, 0.001 * index)  # what is kept of a frozen tile is of another frame
    given: dict[str, Any] = {"color": color, "depth": seen.pop("depth"), "gbuffer": seen, "jitter": jitter}
    shown = surfaces(display, (0.0, 0.0), 0.001 * index)
    return frame_at(1, render, display, **given, motion=motion, reset=index == 0, gbuffer_display=shown)


def test_frozen_tiles_are_skipped_without_a_changed_bit() -> None:
    render, display = (44, 14), (88, 28)
    whole, skipping = (make(METHOD, display=display, skip=skip) for skip in (False, True))
    for index in range(88):
        frame = still(index, render, display)
        result = whole.step(frame, outputs=("converged",))
        assert isinstance(result, StepResult)
        np.testing.assert_array_equal(skipping.step(frame), result.image, f"frame {index}")
        if index in (79, 82):
            assert result.converged is not None
            frozen = float(result.converged.mean())
            assert (frozen == 1.0) == (index == 79), frozen
            assert frozen > 0.5, "there is something to skip"


def test_a_state_continues_the_history_of_reflectance() -> None:
    (render, display), upscalers = SIZES[3], [make(METHOD, display=SIZES[3][1]) for _ in range(2)]
    for index in range(3):
        upscalers[0].step(frame_at(index, render, display))
    upscalers[1].load_state(upscalers[0].save_state())
    ours, theirs = (each.step(frame_at(3, render, display)) for each in upscalers)
    assert np.abs(display_transform(ours) - display_transform(theirs)).max() < 0.02


def test_maps_and_aovs_are_those_of_the_cpu_backend() -> None:
    (render, display), names = SIZES[3], ("aovs", "weight", "class_map", "count")
    ours, theirs = (make(METHOD, executor, display=display) for executor in ("gpu", "cpu"))
    for index in range(4):
        aovs = np.random.default_rng(index).random((render[1], render[0], 2), np.float32)
        frame = frame_at(index, render, display, aovs=aovs)
        results = [each.step(frame, outputs=names) for each in (ours, theirs)]
        for name in names:
            one, other = (getattr(result, name) for result in results)
            assert np.abs(one - other).mean() < (0.05 if name == "count" else 0.01), (name, index)


def test_textures_give_the_images_of_arrays_and_wrong_ones_are_refused_by_name(device: Any) -> None:
    (render, display) = SIZES[3]
    upscaler, arrays = make(METHOD, display=display), make(METHOD, display=display)
    for index in range(3):
        frame = frame_at(index, render, display)
        images = textures_of(device, frame) | gbuffer_textures(device, frame)
        image = upscaler.step_textures(images, jitter=frame.jitter, exposure=1.0, reset=frame.reset)
        shown = [display_transform(each) for each in (pixels_of(device, image), arrays.step(frame))]
        assert np.abs(shown[0] - shown[1]).max() < 0.01
    for name, wrong in (("gbuffer_display_normal", images["gbuffer_normal"]), ("gbuffer_base_color", None)):
        with pytest.raises(FrameError, match=name):
            upscaler.step_textures({**images, name: wrong}, jitter=frame.jitter)


def gbuffer_textures(device: Any, frame: Frame) -> dict[str, Any]:
    formats = {3: ("rgba32float", 4), 1: ("r32float", 1)}
    return {
        name: texture_of(device, GBUFFERS[name].find(frame), *formats[GBUFFERS[name].channels])
        for name in GBUFFERS_READ
    }
