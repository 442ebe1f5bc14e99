"""What stands still converges to the mean of its samples, and what changes is shown at once."""

import dataclasses
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from supersampler import Frame, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.io.display import decibels, display_transform
from supersampler.methods.convergence import MAX_STATIC_MOTION, PERIOD
from supersampler_export.cli import load_method
from supersampler_model.data.scenes.analytic import DiscOverPlane, Plane, Scene
from supersampler_model.data.scenes.still_life import still_life, still_scene
from supersampler_model.methods.base import Method
from supersampler_model.ops.size import Size as TorchSize
from torch_inputs import plain_inputs

DISPLAY: Size = (160, 90)
METHODS = ["taau", "classifier", "classifier-small"]
HALTON = jitter_phase_count(2.0)
BLOCK = (slice(40, 56), slice(20, 36))  # 16x16 display pixels among the waves

method_of = cache(load_method)


def magnified(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of the still scene, at twice its size."""
    return still_life(16.0 + 0.5 * x, 9.0 + 0.5 * y)


STILL = Plane(magnified)
MOVER = DiscOverPlane(
    velocity=(0.5, 0.0), background_velocity=(0.0, 0.0), start=(-4.0, 8.0), radius=4.0, pattern=magnified
)


class Steps:
    """Steps a torch method frame by frame."""

    def __init__(self, method: Method, display: Size = DISPLAY) -> None:
        self._method, self._display = method, display
        self._history: list[torch.Tensor] = []
        self._aux: list[torch.Tensor] = []

    def copy(self) -> "Steps":
        """Return one that goes on from here."""
        other = Steps(self._method, self._display)
        other._history = self._history
        return other

    def step(self, frame: Frame) -> Float32:
        """Return the image, (H, W, 3)."""
        assert frame.color is not None
        method = self._method
        if frame.reset or not self._history:
            self._history = method.first_history(TorchSize(*self._display), TorchSize(*frame.size))
        planes = {
            "color": np.asarray(frame.color, np.float32).transpose(2, 0, 1),
            "depth": frame.depth[None],
            "motion": np.asarray(frame.motion, np.float32).transpose(2, 0, 1),
        }
        tensors = {name: torch.from_numpy(np.ascontiguousarray(a))[None] for name, a in planes.items()}
        tensors |= {
            "jitter": torch.tensor([frame.jitter]),
            "exposure": torch.tensor([frame.exposure or 0.0]),
            "display_size": torch.tensor(self._display),
            **plain_inputs(frame.size),
        }
        with torch.no_grad():
            done = method.step(*(tensors[name] for name in method.inputs()), *self._history)
        self._history, self._aux = done.history, done.aux_outputs
        return done.image[0].numpy().transpose(1, 2, 0)

    def history(self, name: str) -> Float32:
        """Return a history tensor, (h, w, c)."""
        index = list(self._method.history).index(name)
        return self._history[index][0].numpy().transpose(1, 2, 0)

    @property
    def own(self) -> Float32:
        """The method's own image of the last frame, as its history keeps it."""
        return self.history("color")

    @property
    def converged(self) -> Float32:
        """(H, W) fraction of the mean in the last image."""
        index = self._method.spec.aux_outputs.index("converged")
        return self._aux[index][0, 0].numpy()


def frames(count: int, ratio: float = 2.0, scene: Scene = STILL, display: Size = DISPLAY) -> list[Frame]:
    """Return the first frames of a scene."""
    size = (round(display[0] / ratio), round(display[1] / ratio))
    return [scene.frame(index, size, halton_jitter(index, ratio)) for index in range(count)]


def changed(frame: Frame, change: Callable[[Float32], None]) -> Frame:
    """Return the frame with its colour, a copy, changed."""
    color = np.array(frame.color, np.float32)
    change(color)
    return Frame(
        color=color, depth=frame.depth, motion=frame.motion, jitter=frame.jitter, exposure=frame.exposure
    )


def brighter(values: Float32, by: float) -> Float32:
    """Return colours that are brighter by a difference of display values."""
    low, high = values, np.full_like(values, 8.0)
    target = display_transform(values) + by
    for _ in range(30):
        middle = 0.5 * (low + high)
        dark = display_transform(middle) < target
        low, high = np.where(dark, middle, low), np.where(dark, high, middle)
    return high


def psnr(image: Float32, truth: Float32, where: NDArray[np.bool_] | None = None) -> float:
    error = (display_transform(image) - display_transform(truth)) ** 2
    return decibels(float(np.mean(error if where is None else error[where])))


@cache
def truth() -> Float32:
    return STILL.truth(0, DISPLAY)


@cache
def _settled(name: str, count: int) -> Steps:
    steps = Steps(method_of(name))
    for frame in frames(count):
        steps.step(frame)
    return steps


def settled(name: str, count: int) -> Steps:
    """Return a method after frames of the still scene."""
    return _settled(name, count).copy()


@pytest.mark.parametrize("ratio", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("name", METHODS)
def test_two_periods_reach_42_db_and_no_frame_is_worse_than_the_method_alone(name: str, ratio: float) -> None:
    steps, period, scores = Steps(method_of(name)), jitter_phase_count(ratio), []
    for frame in frames(2 * period, ratio):
        scores.append(psnr(steps.step(frame), truth()))
        assert scores[-1] > psnr(steps.own, truth()) - 0.1
    assert np.mean(scores[-period // 4 :]) > 42.0


def test_patterns_finer_than_a_sample_open_hardly_anything_once_a_period_was_seen() -> None:
    steps = Steps(method_of("taau"))
    for index, frame in enumerate(frames(2 * HALTON, scene=still_scene())):
        image = steps.step(frame)
        assert index < HALTON or (steps.converged == 0.0).mean() < 0.015
    assert psnr(image, still_scene().truth(0, DISPLAY)) > 39.0


@pytest.mark.parametrize("name", METHODS)
def test_the_fourth_period_hardly_flickers(name: str) -> None:
    steps = settled(name, 3 * HALTON)
    shown = [display_transform(steps.step(frame)) for frame in frames(4 * HALTON)[3 * HALTON :]]
    assert np.std(shown, axis=0).mean() < 0.0005


@pytest.mark.parametrize("name", METHODS)
def test_the_still_part_beside_a_mover_converges_as_well(name: str) -> None:
    steps, below = Steps(method_of(name)), np.zeros(DISPLAY[::-1], bool)
    below[DISPLAY[1] // 2 :] = True  # the disc crosses the upper half
    for frame in frames(2 * HALTON, scene=MOVER):
        image = steps.step(frame)
    still = settled(name, 2 * HALTON - 1).step(frames(2 * HALTON)[-1])
    assert psnr(image, truth(), below) > psnr(still, truth(), below) - 1.0


@pytest.mark.parametrize("name", METHODS)
def test_what_moves_is_the_methods_own_image_bit_for_bit(name: str) -> None:
    steps = Steps(method_of(name))
    for frame in frames(6, scene=Plane(magnified, (2.0 * MAX_STATIC_MOTION, 0.0))):
        np.testing.assert_array_equal(steps.step(frame), steps.own)
        assert not steps.converged.any()


@pytest.mark.parametrize("name", METHODS)
def test_a_mover_leaves_nothing_of_itself_in_the_mean(name: str) -> None:
    steps = Steps(method_of(name))
    for frame in frames(3 * HALTON, scene=MOVER):
        steps.step(frame)
    settled_again = steps.history("static_mean")[..., 3] > PERIOD
    error = np.abs(display_transform(steps.history("static_mean")[..., :3]) - display_transform(truth()))
    assert settled_again[: DISPLAY[1] // 2].mean() > 0.3
    assert error[settled_again].max() < 0.2  # the disc's rings differ from what is behind by up to 1


@pytest.mark.parametrize("phase", [0, 7, 13])
@pytest.mark.parametrize("name", METHODS)
def test_a_change_of_8_of_255_opens_in_its_first_frame_and_restarts_in_its_second(
    name: str, phase: int
) -> None:
    steps, count = settled(name, 2 * HALTON + phase), 2 * HALTON + phase

    def change(color: Float32) -> None:
        part = tuple(slice(s.start // 2, s.stop // 2) for s in BLOCK)
        color[part] = brighter(color[part], 8.0 / 255.0)

    first, second = (changed(frame, change) for frame in frames(count + 2)[count:])
    image = steps.step(first)
    assert (steps.converged[BLOCK] == 0.0).mean() > 0.9
    np.testing.assert_array_equal(image[BLOCK][4:-4, 4:-4], steps.own[BLOCK][4:-4, 4:-4])
    assert steps.converged[65:].min() == 1.0  # nothing else opened
    steps.step(second)
    assert (np.abs(steps.history("static_mean")[BLOCK][..., 3]) < 1.5).mean() > 0.9


@pytest.mark.parametrize("name", METHODS)
def test_a_change_of_3_of_255_opens_within_a_period(name: str) -> None:
    steps, opened = settled(name, 2 * HALTON), np.zeros((16, 16), bool)

    def change(color: Float32) -> None:
        part = tuple(slice(s.start // 2, s.stop // 2) for s in BLOCK)
        color[part] = brighter(color[part], 3.0 / 255.0)

    for frame in frames(3 * HALTON)[2 * HALTON :]:
        steps.step(changed(frame, change))
        opened |= steps.converged[BLOCK] == 0.0
    assert opened.mean() > 0.9


def waves(along: str, phase: float = 0.0) -> Plane:
    """Return waves along an axis, five display pixels long: all are as bright, over a few samples."""

    def pattern(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        bright = 0.5 + 0.4 * np.cos(2.0 * np.pi * (x if along == "x" else y) / 3.2 + phase)
        return np.repeat(bright[..., None], 3, axis=-1)

    return Plane(pattern)


def test_a_still_scene_replaced_by_another_pattern_as_bright_is_gone_within_two_jitter_periods() -> None:
    display = (100, 56)
    steps = Steps(method_of("taau"), display)
    for frame in frames(2 * HALTON, scene=waves("x"), display=display):
        steps.step(frame)
    for frame in frames(2 * HALTON, scene=waves("y"), display=display):
        image = steps.step(dataclasses.replace(frame, reset=False))
    error = np.abs(display_transform(image) - display_transform(waves("y").truth(0, display)))
    assert np.quantile(error, 0.99) < 0.05


def test_one_frame_of_another_pattern_only_doubts_the_mean_and_a_second_restarts_it() -> None:
    steps, display = Steps(method_of("taau"), (100, 56)), (100, 56)
    for frame in frames(2 * HALTON + 1, scene=waves("x"), display=display):
        steps.step(frame)
    first, second = frames(2 * HALTON + 3, scene=waves("x", np.pi), display=display)[-2:]
    steps.step(first)
    doubted = (steps.history("static_mean")[..., 3] < 0.0) & (steps.converged > 0.0)
    assert doubted.mean() > 0.2
    assert (steps.converged[doubted] == 1.0).all()
    confirmed, refuted = steps.copy(), steps.copy()
    confirmed.step(second)
    assert (confirmed.history("static_mean")[..., 3][doubted] < 1.0).mean() > 0.5
    refuted.step(frames(2 * HALTON + 3, scene=waves("x"), display=display)[-1])
    assert (refuted.history("static_mean")[..., 3][doubted] >= PERIOD).all()


@pytest.mark.parametrize("name", METHODS)
def test_missing_samples_of_a_resting_region_cost_it_nothing(name: str) -> None:
    steps, plain = settled(name, 2 * HALTON), settled(name, 2 * HALTON)
    for index, frame in enumerate(frames(2 * HALTON + 4)[2 * HALTON :]):
        bad = changed(frame, lambda color: color[10:18, 15:23].fill(np.nan)) if index < 2 else frame
        image, expected = steps.step(bad), plain.step(frame)
    assert np.abs(display_transform(image) - display_transform(expected)).max() < 0.02
    assert steps.converged.min() == 1.0


@pytest.mark.parametrize("light", [20.0, 60000.0])
@pytest.mark.parametrize("at", [6, 2 * HALTON + 7])
@pytest.mark.parametrize("name", METHODS)
def test_one_firefly_hardly_shows_in_the_mean(name: str, at: int, light: float) -> None:
    steps, plain = settled(name, at), settled(name, at)
    first, *later = frames(at + HALTON)[at:]
    plain.step(first)
    steps.step(changed(first, lambda color: color[22, 15].fill(light)))
    differences = [display_transform(steps.step(f)) - display_transform(plain.step(f)) for f in later]
    assert np.abs(differences[-1]).max() < 0.1
    if at > HALTON:
        assert np.abs(differences[0]).max() < 0.05
        assert steps.history("static_mean")[..., 3].min() > PERIOD  # nothing restarted


@pytest.mark.parametrize("name", METHODS)
def test_a_reset_forgets_all(name: str) -> None:
    steps, fresh = settled(name, HALTON), Steps(method_of(name))
    for index, frame in enumerate(frames(3)):
        cut = dataclasses.replace(frame, reset=index == 0)
        np.testing.assert_array_equal(steps.step(cut), fresh.step(frame))


@pytest.mark.parametrize("name", METHODS)
def test_another_render_size_keeps_the_mean(name: str) -> None:
    steps = settled(name, 2 * HALTON)
    before = steps.history("static_mean")[..., 3]
    for frame in frames(12, ratio=1.5):
        image = steps.step(dataclasses.replace(frame, reset=False))
        assert psnr(image, truth()) > 42.0
    assert (steps.history("static_mean")[..., 3] > before).all()


@pytest.mark.parametrize("name", METHODS)
def test_jitter_that_never_repeats_converges(name: str) -> None:
    random = np.random.default_rng(5)
    steps = Steps(method_of(name))
    for index in range(3 * HALTON):
        jitter = tuple(random.uniform(-0.5, 0.5, 2))
        image = steps.step(STILL.frame(index, (80, 45), jitter))
    assert psnr(image, truth()) > psnr(steps.own, truth()) + 3.0


@pytest.mark.parametrize("name", METHODS)
def test_without_jitter_the_image_is_the_methods_own(name: str) -> None:
    steps = Steps(method_of(name))
    for index in range(40):
        np.testing.assert_array_equal(steps.step(STILL.frame(index, (80, 45))), steps.own)


@pytest.mark.parametrize("name", METHODS)
def test_a_scene_of_high_range_converges_in_linear_light(name: str) -> None:
    """Bright lines half a sample wide; a mean of toned values is darker."""

    def lines(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.repeat(np.where(np.abs((x + 0.3 * y) % 8.0 - 4.0) < 0.2, 8.0, 0.2)[..., None], 3, axis=-1)

    scene = Plane(lines)
    steps, want = Steps(method_of(name)), scene.truth(0, DISPLAY)
    for frame in frames(2 * HALTON, scene=scene):
        image = steps.step(frame)
    assert psnr(image, want) > psnr(steps.own, want) + 3.0
    assert abs(image.mean() - want.mean()) < 0.5 * abs(steps.own.mean() - want.mean())
