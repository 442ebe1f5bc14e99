"""`fsr2-like` on analytic scenes: each pass does what FSR2's documentation says it is for."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from checker_shot import write_checker_shot
from supersampler import Frame, FrameError
from supersampler.conventions.jitter import halton_jitter
from supersampler.frame import Float32, Size
from supersampler.io.display import BT709, display_transform
from supersampler.io.shot import Shot
from supersampler_bench import fsr2
from supersampler_bench.fsr2 import FSR2_LIKE, Fsr2Like
from supersampler_bench.quality import metrics
from supersampler_bench.quality.measure import measure_quality, runnable
from supersampler_model.data.scenes.analytic import (
    AnalyticScene,
    DiscOverPlane,
    Plane,
    Values,
    checker,
    plain,
)

RENDER, DISPLAY = (48, 27), (96, 54)
SMALL = (32, 18)


def images(
    scene: AnalyticScene, count: int, render: Size = RENDER, display: Size = DISPLAY
) -> Iterator[tuple[int, Float32]]:
    upscaler = Fsr2Like(display)
    for index in range(count):
        yield index, upscaler.step(scene.frame(index, render, halton_jitter(index, display[0] / render[0])))


def last(scene: AnalyticScene, count: int) -> Float32:
    return list(images(scene, count, RENDER, DISPLAY))[-1][1]


def psnr(image: Float32, truth: Float32) -> float:
    """PSNR (dB) of display values without four pixels along the border."""
    return metrics.psnr(*(metrics.crop(display_transform(each), 4) for each in (image, truth)))


@pytest.mark.parametrize("display", [(48, 27), (54, 31), (64, 36), (96, 54)])
def test_a_still_scene_converges_to_the_truth(display: Size) -> None:
    scene = Plane(checker)
    truth = scene.truth(0, display)
    steps = dict(images(scene, 65, SMALL, display))
    assert psnr(steps[64], truth) > psnr(steps[16], truth) + 1.0 > psnr(steps[0], truth) + 2.0


def test_the_image_of_a_moving_scene_is_not_shifted() -> None:
    scene = Plane(checker, velocity=(0.9, -0.55))
    steps, truth = dict(images(scene, 24)), scene.truth(23, DISPLAY)
    image = steps[23]
    scores = {(x, y): psnr(np.roll(image, (y, x), (0, 1)), truth) for x in (-1, 0, 1) for y in (-1, 0, 1)}
    best = scores.pop((0, 0))
    assert best > psnr(steps[0], scene.truth(0, DISPLAY)) + 1.0
    assert best > max(scores.values()) + 2.0


def test_the_depth_clip_removes_the_ghost_of_a_surface_in_front(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = DiscOverPlane(velocity=(3.0, 0.0), background_velocity=(0.0, 0.0), start=(10.0, 18.0))
    uncovered, truth = scene.disoccluded(11, DISPLAY), display_transform(scene.truth(11, DISPLAY))

    def error() -> float:
        return float(np.abs(display_transform(last(scene, 12)) - truth)[uncovered].mean())

    clipped = error()
    monkeypatch.setattr(fsr2, "disocclusion", lambda depth, *_: np.zeros_like(depth))
    assert clipped < 0.9 * error()


def line(x: Values, y: Values) -> Values:
    """A white line on dark grey, a third of a small frame's pixel wide, slightly tilted."""
    return np.where((np.abs(x - 20.3 - 0.11 * y) < 0.3)[..., None], 1.0, np.full(3, 0.05))


def test_locks_keep_a_thin_line_bright_and_still(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, display = Plane(line), (64, 36)
    on_line = scene.truth(0, display)[..., 0] > 0.1

    def shown() -> Float32:
        steps = [display_transform(image)[on_line] for _, image in images(scene, 64, SMALL, display)]
        return np.array(steps[-12:])

    locked = shown()
    monkeypatch.setattr(fsr2, "thin_features", lambda luma: np.zeros(luma.shape, bool))
    unlocked = shown()
    assert locked.mean() > 1.3 * unlocked.mean()
    assert np.abs(np.diff(locked, axis=0)).mean() < 0.6 * np.abs(np.diff(unlocked, axis=0)).mean()


def test_a_change_of_all_light_shows_at_once() -> None:
    scene, display = Plane(checker), (64, 64)  # one whole cell of the grid of shading
    old, fresh = Fsr2Like(display), Fsr2Like(display)
    for index in range(32):
        frame = scene.frame(index, (32, 32), halton_jitter(index, 2.0))
        color = np.asarray(frame.color) * np.float32(0.2 if index < 28 else 1.0)
        image = old.step(dataclasses.replace(frame, color=color))
        if index >= 28:
            wanted = fresh.step(frame)
    truth = scene.truth(0, display)
    assert psnr(image, truth) > psnr(wanted, truth) - 0.5


def test_the_exposure_comes_from_the_frame_or_is_measured() -> None:
    scene, display = Plane(checker, velocity=(0.9, -0.55)), (64, 36)

    def image(exposure: float | None) -> Float32:
        upscaler = Fsr2Like(display)
        for index in range(12):
            frame = scene.frame(index, SMALL, halton_jitter(index, 2.0))
            found = upscaler.step(dataclasses.replace(frame, exposure=exposure))
        return found

    logs = np.log(np.asarray(scene.frame(0, SMALL).color) @ BT709)
    measured = fsr2.auto_exposure(float(logs.mean()))
    off = [np.abs(image(None) - image(given)).max() for given in (measured, 100.0 * measured)]
    assert off[0] < 0.1 * off[1]


def test_after_a_cut_nothing_of_the_history_is_left() -> None:
    scene = Plane(checker)
    frame = scene.frame(0, RENDER, (0.2, -0.3))
    upscaler = Fsr2Like(DISPLAY)
    for index in range(1, 4):
        upscaler.step(Plane(plain).frame(index, RENDER, halton_jitter(index, 2.0)))
    np.testing.assert_array_equal(upscaler.step(frame), Fsr2Like(DISPLAY).step(frame))


def spoiled(frame: Frame, bad: float) -> Frame:
    """Return a frame with a band of a value in each buffer."""
    arrays: dict[str, Any] = {name: np.array(getattr(frame, name)) for name in ("color", "depth", "motion")}
    for row, array in enumerate(arrays.values()):
        array[3 * row + 2 : 3 * row + 5] = bad
    return dataclasses.replace(frame, **arrays)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, 1e30])
@pytest.mark.parametrize("exposure", [None, 1.0, 1e-6])
@pytest.mark.filterwarnings("error")
def test_bad_values_leave_images_finite_and_later_frames_recover(bad: float, exposure: float | None) -> None:
    scene, upscaler = Plane(checker), Fsr2Like((64, 36))
    for index in range(20):
        frame = dataclasses.replace(scene.frame(index, SMALL, halton_jitter(index, 2.0)), exposure=exposure)
        image = upscaler.step(spoiled(frame, bad) if index in (0, 3, 4) else frame)
        assert np.isfinite(image).all()
        assert (image >= 0.0).all()
    assert psnr(image, scene.truth(0, (64, 36))) > 22.0


def test_the_render_size_may_change_between_frames() -> None:
    scene, upscaler = Plane(checker), Fsr2Like((64, 36))
    for index in range(40):
        render = SMALL if index < 20 else (43, 24)
        image = upscaler.step(scene.frame(index, render, halton_jitter(index, 64 / render[0])))
    assert psnr(image, scene.truth(0, (64, 36))) > 22.0


def test_a_frame_that_was_not_shaded_is_refused() -> None:
    frame = dataclasses.replace(Plane(checker).frame(0, RENDER), color=None)
    with pytest.raises(FrameError, match="color"):
        Fsr2Like(DISPLAY).step(frame)


def test_the_bench_measures_it_beside_other_methods(tmp_path: Path) -> None:
    shot = Shot.open(write_checker_shot(tmp_path, 3))
    assert runnable(shot, [FSR2_LIKE, "bilinear"], pytest.fail) == [FSR2_LIKE, "bilinear"]
    ours, bilinear = measure_quality(shot, [FSR2_LIKE, "bilinear"])
    assert ours.method == FSR2_LIKE
    assert ours.frames[-1].full["psnr"] != bilinear.frames[-1].full["psnr"] > 10.0
