"""`taau`: its rules by numbers worked out by hand, planes of luma, and light that changes or moves."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rest_scenes import Light, RestScene, flat, stripes, wave
from supersampler import Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.constants import GLARE
from supersampler.methods.taau.spec import MOST_SAMPLES, TaauConfig
from supersampler_model import ops
from supersampler_model.data.scenes.analytic import (
    NEAR,
    AnalyticScene,
    Mask,
    SurfaceSample,
    Values,
    Vector,
    frontal,
    grey,
    places,
)
from supersampler_model.methods.taau import (
    Blend,
    CurrentFrame,
    Moments,
    Taau,
    WarpedHistory,
    fit_of,
    light_after,
    plane_moments,
    samples_kept,
    shade_of,
)
from supersampler_model.ops import at_rest
from torch_inputs import Stepped

RULES = Taau()
C = RULES.config
RENDER = ops.Size(12, 9)
SIGMA = 0.4
X, Y = torch.arange(12.0).expand(9, 12), torch.arange(9.0)[:, None].expand(9, 12)
START = 40
DISPLAY = (128, 72)
STEP = 1.0 / 255.0
"""A step of an 8-bit image."""


def plane(*values: float) -> Tensor:
    return torch.tensor(values).reshape(1, -1, 1, 1)


def present(mean: float = 0.5, fit: float = 0.0) -> CurrentFrame:
    """Grey: a frame of luma 0.3, a sample of 0.5, a neighbourhood from 0.2 to 0.6, and `mean` around it."""
    moments = Moments(plane(0.4, 0.0, 0.0), plane(0.2**2, 1e-2, 1e-2), plane(1.0))
    frame, sample = plane(0.3, 0.0, 0.0), plane(0.5, 0.0, 0.0)
    return CurrentFrame(frame, sample, plane(0.5), moments, plane(fit), plane(mean, 0.1), plane(0.0))


def remembered(luma: float = 0.4, surface: float = 1.0, unchanged: float = 1.0) -> WarpedHistory:
    """Ten samples of a spread of 0.1."""
    light, color, none = plane(luma, luma, luma), plane(luma, 0.0, 0.0), plane(0.0)
    known = plane(unchanged), plane(surface)
    return WarpedHistory(light, color, plane(10.0), plane(0.01), none, *known, none, none)


def test_a_flash_keeps_the_history_where_light_has_not_changed() -> None:
    blend = RULES.network(present(), remembered(surface=0.5), plane(1.0))
    assert blend.unconfirmed
    assert float(blend.kept) == pytest.approx(5.0)
    assert not RULES.network(present(), remembered(), plane(0.0)).unconfirmed
    assert not RULES.network(present(), remembered(unchanged=0.0), plane(1.0)).unconfirmed


def changed(difference: Tensor, usable: float = 1.0, shift: float = 0.0, spread: float = 0.0) -> Tensor:
    """Change of light by cell, (5, 6), of samples less a history of 0.4; `shift` is their motion."""
    history = torch.full((1, 3, 18, 24), 0.4 / 0.6)
    motion = torch.zeros(1, 2, 9, 12) + shift
    view = ops.View(ops.Size(24, 18), RENDER, torch.zeros(1, 2))
    luma = 0.4 + difference.expand(9, 12)[None, None]
    power = torch.full((1, 1, 18, 24), spread**2)
    found = RULES.change_of_light(luma, torch.full_like(luma, usable), motion, history, power, view)
    return found[0, 0]


@pytest.mark.parametrize(("steps", "expected"), [(0.9, 0.0), (1.5, 0.5), (-1.5, 0.5), (3.0, 1.0)])
def test_light_changed_where_all_samples_differ_from_the_history_alike(steps: float, expected: float) -> None:
    found = changed(torch.tensor(steps * C.least_change))
    torch.testing.assert_close(found, torch.full((5, 6), expected), rtol=0.0, atol=1e-3)


def test_the_edge_of_a_shadow_is_a_change_of_light_and_aliasing_is_none() -> None:
    assert changed(torch.where(X < 2.0, 0.2, 0.0))[:, :2].min() > 0.5
    assert changed(torch.where(X < 2.0, 0.2, 0.0))[:, 3:].max() == 0.0
    aliased = torch.where((X + 2.0 * Y) % 4.0 < 2.0, 0.2, -0.2)
    assert changed(aliased).max() == 0.0
    firefly = torch.where((X == 6.0) & (Y == 4.0), 0.5, 0.0)
    assert changed(firefly).max() < 0.1


def test_samples_that_all_differ_as_much_as_in_earlier_frames_are_no_change_of_light() -> None:
    assert changed(torch.tensor(0.1)).min() == 1.0
    assert changed(torch.tensor(0.1), spread=0.15).max() == 0.0
    assert changed(torch.tensor(0.3), spread=0.15).min() == 1.0
    assert changed(torch.tensor(0.1), spread=GLARE**0.5).min() == 1.0  # frames with glare, no spread


def test_missing_samples_and_those_from_off_screen_do_not_count() -> None:
    assert changed(torch.tensor(0.2), usable=0.0).max() == 0.0
    assert changed(torch.tensor(0.2), shift=6.0)[:, 4:].max() == 0.0
    assert changed(torch.tensor(0.2), shift=6.0)[0, 0] == 1.0


def test_samples_are_compared_with_the_nearest_pixel_where_they_were() -> None:
    """A history that is a ramp: in samples of the same ramp, moved by whole samples, no light changed."""
    x, y = torch.arange(24.0).expand(18, 24), torch.arange(18.0)[:, None].expand(18, 24)
    history = torch.zeros(1, 3, 18, 24) + (0.2 + 0.01 * x + 0.005 * y)
    motion = torch.tensor([1.0, -1.0])[None, :, None, None].expand(1, 2, 9, 12)
    view = ops.View(ops.Size(24, 18), RENDER, torch.tensor([[0.25, -0.25]]))  # a pixel's centre: 2 x + 1, 2 y
    exposed = 0.2 + 0.01 * (2.0 * X + 1.0 + 2.0) + 0.005 * (2.0 * Y - 2.0)
    luma = ops.ycocg(ops.tone(exposed.expand(1, 3, 9, 12)))[:, :1]
    found = RULES.change_of_light(
        luma, torch.ones_like(luma), motion, history, torch.zeros(1, 1, 18, 24), view
    )
    assert found.max() == 0.0


def lights(*contrasts: float) -> list[bool]:
    """Whether each of these frames, of so much mean square deviation, is a flash."""
    light, found = torch.zeros(1, 4), []
    for contrast in contrasts:
        light = light_after(torch.tensor([[0.3, contrast]]), light, torch.ones(1))
        found.append(bool(light[0, 3]))
    return found


def test_contrast_above_that_of_previous_frames_is_a_flash_for_two_frames_at_most() -> None:
    assert lights(0.01, 0.013, 0.016) == [False] * 3
    assert lights(0.01, 0.01, 0.02, 0.01, 0.01) == [False, False, True, False, False]
    assert lights(0.01, 0.01, 0.02, 0.02, 0.02, 0.02) == [False, False, True, True, False, False]
    extrapolated, shaded = 0.004, 0.01  # extrapolated frames are smooth
    assert lights(*[shaded, extrapolated] * 3, extrapolated, shaded) == [False] * 8


def power_after(
    luma: float, *, samples: float = 4.0, spreads: float = 1.0, around: float = 0.0, fit: float = 0.0
) -> float:
    """Squared spread after a sample of 0.5, the spread so far being 0.1.

    `luma` is the history, `around` the mean luma around the sample; the plane, as far as it fits, is at 0.4.
    """
    count, spread = plane(samples), plane(spreads)
    confirmed = torch.zeros(1, 1, 1, 1, dtype=torch.bool)
    blend = Blend(plane(0.2, 0.0, 0.0), plane(0.2), count, spread, spread, count, confirmed)
    current = present(around, fit)
    _, state = RULES.finish(current, remembered(luma), blend, torch.tensor([2.0]), plane(0.0))
    return float(state[0, 1])


@pytest.mark.parametrize(
    ("luma", "setting", "off"),
    [
        (0.4, {}, 0.1),
        (0.6, {}, 0.1),
        (0.1, {}, 0.1 + C.spread_step),
        (0.9, {"samples": 100.0}, 0.1 + C.spread_step),
        (0.1, {"around": 0.45}, 0.05),
        (0.1, {"around": 0.55}, 0.05),
        (0.1, {"fit": 1.0}, 0.1),
        (0.1, {"around": 0.45, "fit": 1.0}, 0.05),
    ],
)
def test_the_spread_follows_a_sample_by_no_more_than_a_step_and_than_its_neighbours_or_their_plane(
    luma: float, setting: dict[str, float], off: float
) -> None:
    """A mean over spread_samples of squares of sample - history, 0.5 - `luma`."""
    rate = 0.5 / (min(setting.get("samples", 4.0), C.spread_samples) + 0.5)
    assert power_after(luma, **setting) == pytest.approx(0.01 + rate * (off**2 - 0.01), rel=1e-4)


def test_without_a_history_or_in_another_light_there_is_no_spread() -> None:
    assert power_after(0.4, samples=0.5e-3) == power_after(0.4, spreads=0.0) == 0.0


def grey_image(luma: Tensor) -> Tensor:
    return torch.cat([luma[None, None], torch.zeros(1, 2, *luma.shape)], dim=1)


def fit(luma: Tensor, usable: Tensor | None = None) -> Tensor:
    usable = torch.ones(1, 1, 9, 12) if usable is None else usable
    image = luma[None, None] * usable
    return fit_of(image, usable, shade_of(image, usable)[:, 1:2])


def inner(image: Tensor, ratio: float) -> Tensor:
    border = int(3 * ratio)
    return image[..., border:-border, border:-border]


@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0])
@pytest.mark.parametrize(("across", "down"), [(0.02, 0.0), (0.0, -0.03), (-0.01, 0.025)])
def test_a_ramp_has_no_variance_and_its_own_value_at_each_pixel(
    ratio: float, across: float, down: float
) -> None:
    luma = 0.4 + across * X + down * Y
    grid = ops.grid_of(ops.Size(round(12 * ratio), round(9 * ratio)), RENDER, torch.tensor([[0.3, -0.2]]))
    whole = grid.pick(fit(luma))
    found = plane_moments(grey_image(luma), torch.ones(1, 1, 9, 12), whole, grid, SIGMA)
    expected = 0.4 + across * grid.x.position + down * grid.y.position[:, None]
    assert inner(whole, ratio).min() == 1.0
    torch.testing.assert_close(inner(found.center[0, 0], ratio), inner(expected, ratio), rtol=0.0, atol=1e-5)
    assert inner(found.variance[:, 0], ratio).max() < 1e-6


@pytest.mark.parametrize(
    "luma", [torch.where(X < 6.0, 0.2, 0.8), torch.where(X + Y < 9.0, 0.2, 0.8), 0.3 + 0.2 * ((X + Y) % 2.0)]
)
def test_edges_and_patterns_are_on_no_plane(luma: Tensor) -> None:
    assert fit(luma)[..., 1:-1, 1:-1].max() < 0.5


def test_where_no_plane_fits_moments_are_those_of_salvi() -> None:
    luma, usable = torch.rand(9, 12, generator=torch.Generator().manual_seed(1)), torch.ones(1, 1, 9, 12)
    grid = ops.grid_of(ops.Size(24, 18), RENDER, torch.tensor([[0.3, -0.2]]))
    found = plane_moments(grey_image(luma), usable, torch.zeros(1, 1, 18, 24), grid, SIGMA)
    first, second, _ = ops.local_moments(grey_image(luma), usable, grid, SIGMA)
    expected = Moments(first, second - first * first, torch.ones_like(found.weight))
    torch.testing.assert_close(found, expected, rtol=0.0, atol=1e-5)


def test_where_a_sample_is_missing_there_is_no_plane_and_without_most_the_variance_is_1() -> None:
    usable = torch.ones(1, 1, 9, 12)
    usable[..., 4, 6] = 0.0
    usable[..., :, 9:] = 0.0
    luma = 0.4 + 0.02 * X
    assert (fit(luma, usable)[..., 3:6, 5:8] == 0.0).all()
    grid = ops.grid_of(ops.Size(24, 18), RENDER, torch.tensor([[0.3, -0.2]]))
    color, everywhere = grey_image(luma) * usable, torch.ones(1, 1, 18, 24)
    found = plane_moments(color, usable, everywhere, grid, SIGMA)
    without = plane_moments(color, usable, 0.0 * everywhere, grid, SIGMA)
    x, y = grid.x.position, grid.y.position
    beside = ((x - 6.0).abs() < 1.0) & ((y[:, None] - 4.0).abs() < 1.0)
    torch.testing.assert_close(found.center[0, 0][beside], without.center[0, 0][beside])
    assert (found.variance[0, 0, :, x > 10.0] == 1.0).all()


def fade(factor: Any, frames: int = 64) -> Light:
    return lambda t: 1.0 + (np.asarray(factor) - 1.0) * min(max(0, t - START), frames) / frames


LIGHTS = {
    "fades by half": fade(0.5),
    "rises to twice": fade(2.0),
    "loses its red": fade([0.5, 1.0, 1.0]),
    "jumps": fade(0.3, 1),
}


@cache
def taau() -> Taau:
    return Taau().eval()


def brightness(image: Float32, truth: Float32) -> Float32:
    """Return the logarithm of the mean colour over that of the truth."""
    ratio: Float32 = np.log(image.mean((0, 1)) / truth.mean((0, 1)))
    return ratio


@pytest.mark.long  # several periods of the jitter
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS)
@pytest.mark.parametrize(
    ("pattern", "adds_samples"), [(wave, 0.0), (stripes(5.0, 0.7), 1.0)], ids=["wave", "stripes at rest"]
)
def test_the_image_lags_by_at_most_8_percent(pattern: Any, light: Light, adds_samples: float) -> None:
    scene = RestScene(pattern, light)
    run = Stepped(taau(), scene.display, adds_samples)
    ratios = np.stack([brightness(run.step(frame), truth) for frame, truth in scene.frames(START + 70)])
    still = ratios[START - 16 : START].mean(axis=0)  # toned samples have another mean
    assert np.abs(ratios[START:] - still).max() < np.log(1.08)


@pytest.mark.parametrize("pattern", [flat, wave, stripes(5.0, 0.7)], ids=["flat", "wave", "stripes"])
def test_ground_under_steady_light_keeps_all_its_samples(pattern: Any) -> None:
    scene = RestScene(pattern)
    run, without = (Stepped(method, scene.display, 0.0) for method in (taau(), Taau(TaauConfig(lag=1e9))))
    for frame, _ in scene.frames(scene.period):
        np.testing.assert_array_equal(run.step(frame), without.step(frame))


def test_missing_samples_and_blocks_that_move_are_not_compared() -> None:
    size, display = ops.Size(32, 32), ops.Size(64, 64)
    color, history = torch.full((1, 3, 32, 32), 0.5), torch.full((1, 3, 64, 64), 0.5)
    color[..., :16, :], history[..., :32, :] = 0.9, 0.1
    blank = at_rest.RestHistory(
        *(torch.zeros(s) for s in ((1, 4, 64, 64), (1, 4, 8, 8), (38, 4, 8, 8), (38, 4)))
    )

    def kept(usable: torch.Tensor, motion: torch.Tensor) -> float:
        frame = at_rest.RestFrame(
            color, motion, torch.zeros(1, 2), torch.ones(1), torch.zeros(1, 1, 32, 32), torch.ones(1)
        )
        still = at_rest.compare(frame, blank, size, display)
        return float(samples_kept(color, usable, history, still, taau().config).min())

    usable, motion = torch.ones(1, 1, 32, 32), torch.zeros(1, 2, 32, 32)
    upper = torch.zeros(1, 1, 32, 32)
    upper[..., :16, :] = 1.0
    assert kept(usable, motion) < 1.0
    assert kept(usable * (1.0 - upper), motion) == pytest.approx(MOST_SAMPLES)
    assert kept(usable, motion + upper) == pytest.approx(MOST_SAMPLES)


@pytest.mark.long  # opens graphs
@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("ratio", [1.5, 2.0])
def test_backends_keep_as_many_samples(executor: Any, ratio: float) -> None:
    scene = RestScene(wave, fade(0.4, 24), place="edge", speed=1.0, render=(75, 47), ratio=ratio)
    run = Stepped(taau(), scene.display, 0.0)
    upscaler = Upscaler("taau", display_size=scene.display, executor=executor, at_rest="off", threads=1)
    for frame, _ in scene.frames(START + 40):
        images = run.step(frame), upscaler.step(frame)
        shown, expected = (display_transform(image, 1.0) for image in images)
        error = np.abs(shown - expected)
        assert error.mean() < 1e-4
        assert np.quantile(error, 0.999) < 1.0 / 255.0


@dataclass(frozen=True)
class Ball(AnalyticScene):
    """A ball in the middle of the screen, before grey, that turns under a light that turns around it.

    `spin` and `turn` are radians a frame, about the vertical axis; `velocity` is of the ball, units a frame.
    """

    spin: float = 0.0
    turn: float = 0.0
    velocity: Vector = (0.0, 0.0)
    gloss: float = 0.0

    RADIUS = 15.0

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the ball where it is, and grey around it."""
        across, down = self.place(index, x, y)
        near = np.sqrt(np.maximum(1.0 - across**2 - down**2, 0.0))
        normal = np.stack([across, down, near], axis=-1)
        before = np.cos(self.spin) * across - np.sin(self.spin) * near
        motion = np.stack(
            [(before - across) * self.RADIUS - self.velocity[0], 0.0 * y - self.velocity[1]], -1
        )
        on = across**2 + down**2 < 1.0
        color = np.where(on[..., None], grey(self.light(index, normal)), 0.3)
        depth = np.where(on, NEAR, 0.5 * NEAR)
        return SurfaceSample(
            color, depth, np.where(on[..., None], motion, 0.0), depth, frontal(x, y), frontal(x, y)
        )

    def light(self, index: int, normal: Values) -> Values:
        angle = 0.6 + index * self.turn
        light = np.array([np.sin(angle), 0.4, np.cos(angle)]) / np.hypot(1.0, 0.4)
        half = light + np.array([0.0, 0.0, 1.0])
        half /= np.linalg.norm(half)
        highlight = self.gloss * np.maximum(normal @ half, 0.0) ** 20
        return np.asarray(0.1 + 0.6 * np.maximum(normal @ light, 0.0) + highlight)

    def place(self, index: int, x: Values, y: Values) -> tuple[Values, Values]:
        """Return places in radii from the ball's middle."""
        left, top = 26.0 + index * self.velocity[0], 18.0 + index * self.velocity[1]
        return (x - left) / self.RADIUS, (y - top) / self.RADIUS

    def middle(self, index: int) -> Mask:
        """(H, W), True on the part of the ball that faces the camera."""
        return np.asarray(np.hypot(*self.place(index, *places(DISPLAY))) < 0.6)


def errors(scene: Ball, ratio: float, count: int = 20) -> list[Float32]:
    """Errors of display values on the ball's middle, frame by frame, after eight frames; elsewhere NaN."""
    run, found = Stepped(taau(), DISPLAY), []
    for index in range(count):
        size = round(DISPLAY[0] / ratio), round(DISPLAY[1] / ratio)
        run.step(scene.frame(index, size, halton_jitter(index, ratio)))
        if index >= 8:
            image = run.tensor("color")[0].transpose(1, 2, 0)  # at rest the image is a mean of samples
            error = display_transform(image, 1.0) - display_transform(scene.truth(index, DISPLAY, 4), 1.0)
            found.append(np.where(scene.middle(index), error[..., 0], np.nan))
    return found


def grid(error: Float32) -> float:
    """Root mean square of what alternates from pixel to pixel."""
    across = 0.25 * (2.0 * error[:, 1:-1] - error[:, :-2] - error[:, 2:])
    down = 0.25 * (2.0 * error[1:-1] - error[:-2] - error[2:])
    return float(np.sqrt(np.nanmean(across**2) + np.nanmean(down**2)))


@pytest.mark.parametrize("ratio", [2.0, 3.0])
@pytest.mark.parametrize(
    "scene",
    [Ball(turn=0.05), Ball(spin=0.05, gloss=0.5), Ball(spin=0.1, turn=-0.1, velocity=(0.5, 0.1), gloss=0.5)],
    ids=["light turns", "glossy ball turns", "both turn and move"],
)
def test_light_that_moves_over_a_smooth_surface_neither_lags_nor_leaves_a_grid(
    scene: Ball, ratio: float
) -> None:
    found = errors(scene, ratio)
    rms = np.sqrt(np.mean([np.nanmean(error**2) for error in found]))
    assert rms < (1.5 if ratio == 2.0 else 2.5) * STEP
    assert np.mean([grid(error) for error in found]) < (0.8 if ratio == 2.0 else 1.1) * STEP
