"""The CPU kernels of convergence compute what `supersampler_model.ops.convergence` computes."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

import pattern_changes
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler_model.data.scenes.still_life import still_scene, still_scene_with_mover
from supersampler_model.ops.convergence import FrameSamples, Settled, settle
from supersampler_model.ops.motion import usable_motion
from supersampler_model.ops.sampling import grid_of
from supersampler_model.ops.size import render_size_of

Edit = Callable[[int, Frame], Frame]
FRAMES = 36
DISPLAY = (63, 35)

assert_close = partial(np.testing.assert_allclose, rtol=1e-5, atol=1e-5)


@cache
def taau() -> Model:
    return Model.load("taau", executor="cpu", threads=2)


def planes(array: NDArray[np.generic]) -> torch.Tensor:
    """(h, w, c) as (1, c, h, w) float32."""
    return torch.from_numpy(np.ascontiguousarray(array, np.float32).transpose(2, 0, 1)[None])


def torch_step(frame: Frame, own: Float32, before: dict[str, Float32], exposure: float) -> Settled:
    """Run the torch operation on a frame, the method's own image and the history, both of the CPU backend."""
    assert frame.color is not None
    samples = FrameSamples(
        planes(frame.color),
        usable_motion(planes(frame.motion)),
        torch.tensor([frame.jitter], dtype=torch.float32),
        torch.from_numpy(before["history.jitter"]),
        torch.tensor([exposure]),
        torch.zeros(()),
        torch.ones(1),
    )
    image = torch.from_numpy(own)
    return settle(
        image,
        samples,
        torch.from_numpy(before["history.static_mean"]),
        torch.from_numpy(before["history.residual_range"]),
        grid_of(render_size_of(image), render_size_of(samples.color), samples.jitter),
    )


def compare(frames: list[Frame], *, confirmed: bool = True) -> NDArray[np.float32]:
    """Step on the CPU and check each step against torch.

    Args:
        frames: the frames.
        confirmed: whether `history.color` is the method's own image: with sudden light it is not.

    Returns:
        (frames, H, W) the map `converged`.
    """
    upscaler = Upscaler(taau(), display_size=DISPLAY, validate="off", skip="exact")
    first = taau().first_history(DISPLAY, frames[0].size)
    before, maps = taau().save_history(first), []
    for index, frame in enumerate(frames):
        result = upscaler.step(frame, outputs=("converged",))
        state = upscaler.save_state().history
        assert state is not None
        after = {name: np.array(array) for name, array in state.items()}
        exposure = abs(float(after["history.exposure"][0]))
        settled = torch_step(frame, after["history.color"], before, exposure)
        weighted = (settled.still[:, 3:] != 0.0).float()  # a color without weight has no effect
        mean = after["history.static_mean"]
        assert_close(mean * weighted.numpy(), settled.still * weighted, err_msg=f"{index}")
        assert_close(mean[:, 3:], settled.still[:, 3:], err_msg=f"{index}")
        assert_close(after["history.residual_range"], settled.opening, err_msg=f"{index}")
        assert_close(result.converged, settled.converged[0, 0], rtol=0, atol=1e-6, err_msg=f"{index}")
        if confirmed:
            image = settled.image[0].numpy().transpose(1, 2, 0)
            assert_close(result.image, image, err_msg=f"{index}")
        before = after
        maps.append(np.array(result.converged))
    return np.stack(maps)


def frames_of(ratio: float = 2.0, edit: Edit | None = None, *, mover: bool = False) -> list[Frame]:
    size = round(DISPLAY[0] / ratio), round(DISPLAY[1] / ratio)
    scene = still_scene_with_mover() if mover else still_scene()
    frames = [scene.frame(index, size, halton_jitter(index, 4.0)) for index in range(FRAMES)]
    return frames if edit is None else [edit(index, frame) for index, frame in enumerate(frames)]


def with_color(frame: Frame, where: tuple[slice, slice], value: object) -> Frame:
    color = np.array(frame.color)
    color[where] = value
    return replace(frame, color=color)


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0])
def test_a_scene_that_stands_converges_alike(ratio: float) -> None:
    assert compare(frames_of(ratio))[-1].mean() > 0.2


def test_beside_a_mover_the_mean_is_the_same() -> None:
    assert 0.2 < compare(frames_of(mover=True))[-1].mean() < 0.95


def test_another_render_size_forgets_the_same_ranges() -> None:
    """Every fifth frame of the second half has another size."""
    small, large = frames_of(2.0), frames_of(1.5)
    frames = [b if i >= 18 and i % 5 == 0 else a for i, (a, b) in enumerate(zip(small, large, strict=True))]
    assert compare(frames)[-1].mean() > 0.5


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_single_samples_that_stand_among_moving_ones_are_compared_alike(share: float) -> None:
    """From frame 18 on only a random part of the samples stands, in frames 27 and 28 all of them do."""
    random = np.random.default_rng(5)

    def edit(index: int, frame: Frame) -> Frame:
        moves = (random.random((18, 32)) > share) & (index >= 18) & (index not in (27, 28))
        return replace(frame, motion=np.where(moves[..., None], 0.75, frame.motion).astype(np.float32))

    compare(frames_of(2.0, edit))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e30, 60000.0])
def test_hostile_samples_are_left_out_alike(bad: float) -> None:
    spots = np.random.default_rng(3).random((18, 32)) < 0.1

    def edit(index: int, frame: Frame) -> Frame:
        if index % 8 != 5:
            return frame
        color, motion = np.array(frame.color), np.array(frame.motion)
        color[spots], motion[np.roll(spots, 3, axis=1)] = bad, bad
        return replace(frame, color=color, motion=motion)

    compare(frames_of(2.0, edit), confirmed=False)


def test_fireflies_are_darkened_alike() -> None:
    def edit(index: int, frame: Frame) -> Frame:
        place = slice(index % 18, index % 18 + 1), slice(5 * index % 32, 5 * index % 32 + 1)
        return with_color(frame, place, (20.0, 3.0, 400.0))

    compare(frames_of(2.0, edit))


@pytest.mark.parametrize("bright", [0, 3, 20])
def test_light_of_one_frame_is_limited_alike_and_soon_invisible(bright: int) -> None:
    spots = np.random.default_rng(4).random((18, 32)) < 0.1

    def edit(index: int, frame: Frame) -> Frame:
        if index != bright:
            return frame
        color = np.array(frame.color)
        color[spots] = 100.0
        return replace(frame, color=color)

    compare(frames_of(2.0, edit), confirmed=False)
    images = []
    for frames in (frames_of(2.0, edit), frames_of(2.0)):
        upscaler = Upscaler(taau(), display_size=DISPLAY, validate="off", skip="exact")
        shown = [display_transform(upscaler.step(frame), 1.0) for frame in frames]
        images.append(shown[-1])
    assert np.abs(images[0] - images[1]).mean() < 0.006


def test_a_change_opens_alike_and_restarts_alike() -> None:
    """A block becomes brighter in frame 24 and darker in frames 30 and 31; one blinks in frame 27."""

    def edit(index: int, frame: Frame) -> Frame:
        color = np.array(frame.color)
        color[4:12, 6:14] *= 1.0 if index < 24 else 5.0 if index not in (30, 31) else 0.2
        color[4:12, 20:28] += 4.0 if index == 27 else 0.0
        return replace(frame, color=color)

    maps = compare(frames_of(2.0, edit), confirmed=False)
    changed, blinking = maps[:, 10:22, 14:26], maps[:, 10:22, 42:54]
    assert changed[23].mean() > 0.5 > 0.1 > changed[24].mean()
    assert blinking[26].mean() > 0.5 > 0.1 > blinking[27].mean()


def test_another_pattern_doubts_alike_and_restarts_alike() -> None:
    maps = compare(pattern_changes.frames((32, 18)), confirmed=False)
    strong, faint = maps[:, :, 8:24], maps[:, :, 42:60]
    for index in (*pattern_changes.EARLY, pattern_changes.ONCE, pattern_changes.TWICE[0]):
        assert (strong[index] > 0.0).mean() > 0.5, "one frame, and an early one, still shows the mean"
    assert strong[pattern_changes.TWICE[1]].mean() < 0.1
    assert faint[pattern_changes.TWICE[1]].mean() > 0.9


def test_a_frame_with_the_jitter_of_the_previous_one_doubts_no_pattern_and_leaves_doubts_alike() -> None:
    once, (first, second) = pattern_changes.ONCE, pattern_changes.TWICE
    strong = compare(pattern_changes.frames((32, 18), repeated=(once, second)), confirmed=False)[:, :, 8:24]
    assert strong[once + 1].mean() > 0.9
    assert (strong[second] > 0.0).mean() > 0.5, "the doubt of the frame before is not confirmed"
    assert strong[first].mean() > 0.5


def test_frames_with_the_jitter_of_the_previous_one_add_nothing_alike() -> None:
    frames = frames_of(2.0)
    repeated = [frames[index - index % 3] for index in range(len(frames))]
    assert compare(repeated)[-1].mean() < compare(frames)[-1].mean()


def test_exposures_that_change_and_that_are_measured_compare_alike() -> None:
    def edit(index: int, frame: Frame) -> Frame:
        return replace(frame, exposure=[1.0, 0.25, 3.0, None][index // 4 % 4])

    assert compare(frames_of(2.0, edit))[-1].mean() > 0.5
