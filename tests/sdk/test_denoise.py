"""`denoise_sequence`: less noise, nothing of other surfaces or shots, and errors that say what is wrong."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noisy_frames import SIZE, decibels, noisy, truth
from supersampler import ArgumentError, Frame, FrameError, Shot, denoise_sequence
from supersampler.conventions.encodings import srgb_encoded
from supersampler.denoising.oidn import Guides
from supersampler.denoising.sequence import Denoised, TemporalDenoiser
from supersampler.denoising.spec import REACH
from supersampler.frame import Array, Float32


def denoised(frames: list[Frame], **options: Any) -> list[Float32]:
    return list(denoise_sequence(frames, per_frame="none", threads=2, **options))


class Blur:
    """A denoiser that leaves much noise; it keeps the colours that it is given."""

    def __init__(self) -> None:
        self.colors: list[Float32] = []

    def clean_guides(self, albedo: Float32 | None, normal: Float32 | None) -> Guides:
        return albedo, normal

    def denoise(self, color: Float32, *_: Float32 | None) -> Float32:
        self.colors.append(color.copy())
        padded = np.pad(color, ((1, 1), (1, 1), (0, 0)), mode="edge")
        return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, (3, 3), (0, 1)).mean((3, 4)))


def run(frames: Iterable[Frame], *, skip: int = 0, lookahead: int = REACH) -> list[Denoised]:
    """Denoise noisy frames, and means of them, by `Blur`."""
    with TemporalDenoiser(per_frame=Blur(), lookahead=lookahead, samples=1, threads=2) as denoiser:
        return list(denoiser.run(frames, skip=skip))


EITHER = pytest.mark.parametrize("denoise", [denoised, lambda frames: [item.image for item in run(frames)]])
"""Frames that are denoised already, and noisy ones."""


def test_noisy_frames_are_averaged_before_they_are_denoised_again() -> None:
    frames, blur = [noisy(index, noise=0.2) for index in range(2 * REACH + 1)], Blur()
    with TemporalDenoiser(per_frame=blur, samples=1, threads=2) as denoiser:
        images = [item.image for item in denoiser.run(frames)]
    assert len(blur.colors) == 2 * len(frames)
    given = [np.asarray(frame.color) for frame in frames]
    alone = [color for color in blur.colors if any(np.array_equal(color, each) for each in given)]
    assert len(alone) == len(frames)
    means = [color for color in blur.colors if not any(color is each for each in alone)]
    assert decibels(means[REACH], REACH) > decibels(alone[REACH], REACH) + 3.0
    blurred = [Blur().denoise(color, None, None) for color in (alone[REACH], means[REACH])]
    assert decibels(images[REACH], REACH) > decibels(blurred[1], REACH) > decibels(blurred[0], REACH)


def test_detail_that_the_denoiser_removes_from_every_frame_comes_back() -> None:
    frames, blur = [noisy(index, noise=0.0) for index in range(2 * REACH + 1)], Blur()
    with TemporalDenoiser(per_frame=blur, threads=2) as denoiser:
        list(denoiser.run(frames))
    lost = Blur().denoise(np.asarray(frames[REACH].color), None, None)
    means = [color for color in blur.colors if not any((color == np.asarray(f.color)).all() for f in frames)]
    mean = max(means, key=lambda color: decibels(color, REACH))
    assert decibels(mean, REACH) > decibels(lost, REACH) + 6.0


@EITHER
def test_an_image_depends_on_no_frame_beyond_its_reach(denoise: Callable[..., list[Float32]]) -> None:
    frames = [noisy(index) for index in range(2 * REACH + 3)]
    whole, part = denoise(frames), denoise(frames[1 : 2 * REACH + 2])
    np.testing.assert_array_equal(part[REACH], whole[REACH + 1])
    changed = [noisy(0, noise=0.3), *frames[1:]]
    assert (denoise(changed)[REACH] != whole[REACH]).any()


@pytest.mark.parametrize("skip", [1, 2, 3, REACH])
def test_skipped_frames_are_neighbours_of_noisy_frames(skip: int) -> None:
    frames = [noisy(index) for index in range(2 * REACH)]
    for one, other in zip(run(frames)[skip:], run(frames, skip=skip), strict=True):
        assert one.frame is other.frame
        np.testing.assert_array_equal(one.image, other.image)


@pytest.mark.parametrize("per_frame", ["none", Blur()])
@pytest.mark.parametrize("lookahead", range(REACH + 1))
def test_images_come_as_soon_as_the_lookahead_is_read(lookahead: int, per_frame: Any) -> None:
    read = []

    def frames() -> Iterator[Frame]:
        for index in range(REACH + 3):
            read.append(index)
            yield noisy(index)

    with TemporalDenoiser(per_frame=per_frame, lookahead=lookahead) as denoiser:
        next(denoiser.run(frames()))
    assert read == list(range(lookahead + 1))
    late = run((noisy(index) for index in range(lookahead + 2)), lookahead=lookahead)
    np.testing.assert_array_equal(run(map(noisy, range(9)), lookahead=lookahead)[0].image, late[0].image)


def test_one_pass_denoises_each_frame_once() -> None:
    frames, blur = [noisy(index) for index in range(4)], Blur()
    with TemporalDenoiser(per_frame=blur, lookahead=0, threads=2) as denoiser:
        images = [item.image for item in denoiser.run(frames)]
    assert len(blur.colors) == len(frames)
    clean = [replace(f, color=Blur().denoise(np.asarray(f.color), None, None)) for f in frames]
    for image, other in zip(images, denoised(clean, passes=1), strict=True):
        np.testing.assert_allclose(image, other, atol=2e-4)  # but for the exposure of noisy frames


@pytest.mark.parametrize("lookahead", [1, 2, REACH])
def test_light_that_changes_evenly_does_not_lag(lookahead: int) -> None:
    frames = []
    for index in range(2 * REACH + 1):
        flat, still = np.full((30, 48, 3), 0.5 + 0.01 * index, np.float32), np.zeros((30, 48, 2), np.float32)
        frames.append(noisy(index, color=flat, motion=still, motion_next=still))
    image = run(frames, lookahead=lookahead)[REACH].image
    np.testing.assert_allclose(image, np.asarray(frames[REACH].color), rtol=2e-3)


@EITHER
def test_nothing_crosses_a_cut(denoise: Callable[..., list[Float32]]) -> None:
    before, after = [noisy(index) for index in range(4)], [noisy(index) for index in range(20, 24)]
    after[0] = replace(after[0], reset=True)
    for image, alone in zip(denoise([*before, *after]), [*denoise(before), *denoise(after)], strict=True):
        np.testing.assert_array_equal(image, alone)


def test_aovs_of_noisy_frames_lose_noise() -> None:
    frames = []
    for index in range(2 * REACH + 1):
        color = np.asarray(noisy(index, noise=0.2).color)
        frames.append(noisy(index, noise=0.2, aovs=np.concatenate([color] * 2, axis=2)))
    aovs: Any = run(frames)[REACH].aovs
    for aov in (aovs[..., :3], aovs[..., 3:]):
        assert decibels(aov, REACH) > decibels(np.asarray(frames[REACH].color), REACH) + 7.0


@EITHER
def test_missing_samples_are_filled_and_darken_no_neighbour(denoise: Callable[..., list[Float32]]) -> None:
    frames = [noisy(index, noise=0.0) for index in range(2 * REACH + 1)]
    whole = denoise(frames)
    color = np.array(frames[REACH].color)
    color[10:13, 20:23] = np.nan
    frames[REACH] = replace(frames[REACH], color=color)
    images = denoise(frames)
    np.testing.assert_allclose(images[REACH - 1], whole[REACH - 1], rtol=0.01)
    np.testing.assert_allclose(images[REACH], whole[REACH], rtol=0.01)


def test_where_no_neighbour_agrees_the_frame_denoised_by_itself_remains() -> None:
    frames = [noisy(index, noise=0.0) for index in range(3)]
    color = np.array(frames[1].color)
    color[10:20, 15:30] = 5.0
    frames[1] = replace(frames[1], color=color)
    calls: list[Float32] = []

    class MeansAreRed(Blur):
        def denoise(self, color: Float32, *_: Float32 | None) -> Float32:
            calls.append(color)
            alone = any(np.array_equal(color, np.asarray(frame.color)) for frame in frames)
            return color if alone else np.broadcast_to(np.array([1e3, 0, 0], np.float32), color.shape)

    with TemporalDenoiser(per_frame=MeansAreRed(), samples=8, threads=2) as denoiser:
        images = [item.image for item in denoiser.run(frames)]
    assert len(calls) == 6
    np.testing.assert_allclose(images[1][13:17, 19:26], 5.0, rtol=0.01)
    assert images[1][2:8, 2:40, 0].mean() > 100.0


@pytest.mark.parametrize("passes", [1, 2])
def test_light_that_changes_does_not_lag_behind(passes: int) -> None:
    def lit(index: int) -> Frame:
        light = np.array([1.0 + 0.08 * index, 1.0, 1.0 - 0.03 * index], np.float32)
        frame = noisy(0, noise=0.0, reset=index == 0, motion=np.zeros((30, 48, 2), np.float32))
        return replace(frame, color=np.asarray(frame.color) * light)

    frames = [lit(index) for index in range(2 * REACH)]
    images = denoised(frames, passes=passes, samples=8)
    ratio = images[REACH] / np.asarray(frames[REACH].color)
    np.testing.assert_allclose(ratio.mean(axis=(0, 1)), 1.0, atol=0.015)  # 0.03 if it lagged


@pytest.mark.parametrize("options", [{}, {"gbuffer": None}])
def test_a_moving_texture_loses_most_of_its_noise(options: dict[str, Any]) -> None:
    frames = [noisy(index, **options) for index in range(2 * REACH + 1)]
    images = denoised(frames, samples=1)
    for index, least in ((0, 2.5), (REACH, 5.0), (2 * REACH, 2.5)):
        noise = decibels(np.asarray(frames[index].color, np.float32), index)
        assert decibels(images[index], index) > noise + least


def test_what_appears_from_nowhere_keeps_its_colour() -> None:
    frames = [noisy(index, noise=0.0) for index in range(9)]
    color = np.array(frames[4].color)
    color[10:20, 20:30] = 5.0  # a flash of one frame
    frames[4] = replace(frames[4], color=color)
    images = denoised(frames)
    np.testing.assert_allclose(images[4][13:17, 23:27], 5.0, rtol=0.05)
    assert np.abs(images[3] - images[4])[13:17, 23:27].min() > 2.0


def test_motion_to_the_next_frame_is_scattered_where_it_is_missing() -> None:
    frames = [noisy(index) for index in range(9)]
    forward = np.negative(frames[0].motion)
    given = [replace(frame, motion_next=forward) for frame in frames]
    without, with_it = denoised(frames), denoised(given)
    noise = decibels(np.asarray(frames[0].color, np.float32), 0)  # frame 0 has following frames only
    assert min(decibels(without[0], 0), decibels(with_it[0], 0)) > noise + 2.5
    assert abs(decibels(without[0], 0) - decibels(with_it[0], 0)) < 1.0


def test_pre_exposure_is_divided_out_and_multiplied_back() -> None:
    frames = [noisy(index) for index in range(5)]
    scaled = [
        replace(frame, color=np.asarray(frame.color) * 2.0**index, pre_exposure=2.0**index)
        for index, frame in enumerate(frames)
    ]
    for index, (image, plain) in enumerate(zip(denoised(scaled), denoised(frames), strict=True)):
        np.testing.assert_allclose(image, plain * 2.0**index, rtol=1e-5)


def test_aovs_are_averaged_by_the_weights_of_the_image() -> None:
    frames = []
    for index in range(5):
        frame = noisy(index)
        frames.append(replace(frame, aovs=np.concatenate([np.asarray(frame.color)] * 2, axis=2)))
    with TemporalDenoiser(per_frame="none") as denoiser:
        for item in denoiser.run(frames):
            assert item.aovs is not None
            np.testing.assert_array_equal(item.aovs[..., :3], item.aovs[..., 3:])
            np.testing.assert_allclose(item.aovs[..., :3], item.image, rtol=0.01)  # without change of light


@pytest.mark.parametrize("size", [(1, 1), (5, 1), (17, 13), (70, 19)])
def test_any_size_of_image_works(size: tuple[int, int]) -> None:
    images = denoised([noisy(index, size=size) for index in range(3)])
    assert [image.shape for image in images] == [(size[1], size[0], 3)] * 3
    assert np.isfinite(np.stack(images)).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 3e38, -1.0])
def test_hostile_values_stay_where_they_are(value: float) -> None:
    frames = [noisy(index) for index in range(5)]
    broken: Any = frames[2]
    for array in (broken.color, broken.depth, broken.motion, *broken.gbuffer.values()):
        array[3:6, 4:8] = value
    images = denoised(frames)
    assert np.isfinite(np.stack(images)).all()
    for index in (0, 2, 4):
        clean = images[index].copy()
        clean[:9, :14] = truth(index)[:9, :14]
        assert decibels(clean, index) > 20.0


def test_frames_of_more_samples_are_averaged_less_and_of_unknown_ones_as_those_of_eight() -> None:
    frames = [noisy(index, noise=0.3, size=(40, 50)) for index in range(4)]
    few, eight, unknown, many = (
        next(denoise_sequence(frames, per_frame="none", samples=count)) for count in (1, 8, None, 1000)
    )
    moved = [np.abs(image - np.asarray(frames[0].color)).mean() for image in (few, eight, many)]
    assert moved[0] > 1.2 * moved[1] > 1.2 * moved[2]
    np.testing.assert_array_equal(eight, unknown)


def test_threads_change_no_bit() -> None:
    frames = [noisy(index, size=(40, 50)) for index in range(4)]
    one, many = (list(denoise_sequence(frames, per_frame="none", threads=count)) for count in (1, 3))
    np.testing.assert_array_equal(np.stack(one), np.stack(many))


@pytest.mark.parametrize(
    ("options", "answer"),
    [
        ({"passes": 3}, "passes is 3; want 1 or 2"),
        ({"lookahead": 6}, "lookahead is 6; want a whole number of frames from 1 to 5, or None"),
        ({"passes": 1, "lookahead": 2}, "lookahead is 2; want None, because one pass reads no later frame"),
        ({"samples": 0}, "samples is 0; want a number above 0, or None"),
        ({"samples": float("nan")}, "samples is nan; want a number above 0, or None"),
        ({"samples": True}, "samples is True; want a number above 0, or None"),
        ({"threads": "x"}, "threads is 'x'; want a whole number from 1 to 256"),
        ({"threads": -1}, "threads is -1; want a whole number from 1 to 256"),
        ({"per_frame": "optix"}, "per_frame is 'optix'; want 'oidn' or 'none'"),
    ],
)
def test_arguments_are_checked_before_anything_is_read(options: dict[str, Any], answer: str) -> None:
    with pytest.raises(ArgumentError) as caught:
        denoise_sequence(iter(()), **options)
    assert answer in str(caught.value)


AOVS = np.ones((*SIZE[::-1], 2), np.float32)


@pytest.mark.parametrize(
    ("frames", "answer"),
    [
        ([noisy(0, color=None)], r"color is None; want the colour of every frame"),
        ([noisy(0, jitter=(0.25, 0.0))], r"jitter is \(0.25, 0.0\); want \(0, 0\) in every frame"),
        ([noisy(0), noisy(1, size=(20, 10))], "the size before"),
        ([noisy(0), noisy(1, aovs=AOVS)], "aovs is 2 channels; want 0 channels as before, or a cut"),
        ([noisy(0, aovs=AOVS), noisy(1)], "aovs is 0 channels; want 2 channels as before, or a cut"),
    ],
)
def test_frames_that_cannot_be_denoised_are_refused(frames: list[Frame], answer: str) -> None:
    with pytest.raises(FrameError, match=answer):
        denoised(frames)


def test_the_size_may_change_at_a_cut() -> None:
    images = denoised([noisy(0), noisy(1, size=(20, 10), reset=True)])
    assert [image.shape[:2] for image in images] == [SIZE[::-1], (10, 20)]


# --- frames of Cycles, each denoised by Open Image Denoise, with references ---


RECORDED = Path(__file__).parents[1] / "blender" / "denoised"  # by record_denoised.py beside it


def shown(image: Array | None) -> Float32:
    assert image is not None
    return srgb_encoded(np.clip(np.asarray(image, np.float32)[8:-8, 8:-8], 0.0, 1.0))


def gains(before: Float32, after: Float32, truth: Float32) -> Any:
    """Return by how much images have come nearer to the truth, in dB."""
    errors = [np.square(film - truth, dtype=np.float64).mean(axis=(1, 2, 3)) for film in (before, after)]
    return 10.0 * np.log10(errors[0] / errors[1])


@pytest.mark.parametrize("passes", [1, 2])
def test_recorded_frames_come_nearer_to_their_references_and_flicker_less(passes: int) -> None:
    recorded = Shot.open(RECORDED)
    images = list(denoise_sequence(recorded, per_frame="none", passes=passes, samples=4, threads=1))
    indices = recorded.reference_indices
    films = [
        np.stack([shown(recorded.read(index).frame.color) for index in indices]),
        np.stack([shown(images[index]) for index in indices]),
        np.stack([shown(recorded.read_reference(index)) for index in indices]),
    ]
    assert len(indices) == 3
    assert gains(*films).min() > 0.2
    assert gains(*(np.diff(film, axis=0) for film in films)).min() > 0.35
