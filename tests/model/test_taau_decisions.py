"""The rules of `taau` by numbers worked out by hand: how much of the history counts, and the next history."""

import pytest
import torch
from torch import Tensor

from supersampler_model import ops
from supersampler_model.methods.taau import Blend, CurrentFrame, Moments, Taau, WarpedHistory, light_after

RULES = Taau()
C = RULES.config


def plane(*values: float) -> Tensor:
    return torch.tensor(values).reshape(1, -1, 1, 1)


def present(
    confidence: float = 0.5, shade: tuple[float, float] = (0.5, 0.1), fit: float = 0.0
) -> CurrentFrame:
    """Grey: a frame of luma 0.3, a sample of 0.5, a neighbourhood from 0.2 to 0.6."""
    return CurrentFrame(
        plane(0.3, 0.0, 0.0),
        plane(0.5, 0.0, 0.0),
        plane(confidence),
        Moments(plane(0.4, 0.0, 0.0), plane(0.2**2, 1e-2, 1e-2)),
        plane(fit),
        plane(*shade),
        plane(0.0),
    )


def remembered(
    luma: float = 0.4, samples: float = 10.0, surface: float = 1.0, speed: float = 0.0, blur: float = 0.0,
    mean: float = 0.5, power: float = 0.01,
) -> WarpedHistory:  # fmt: skip
    return WarpedHistory(
        plane(luma, luma, luma),
        plane(luma, 0.0, 0.0),
        plane(samples),
        plane(power),
        plane(mean, 0.05),
        plane(0.0),
        plane(surface),
        plane(speed),
        plane(blur),
    )


def decided(current: CurrentFrame, warped: WarpedHistory, flash: float = 0.0) -> Blend:
    return RULES.network(current, warped, plane(flash))


def counted(**history: float) -> float:
    """Samples of the history that count."""
    return float(decided(present(), remembered(**history)).samples)


def test_a_history_like_the_frame_counts_whole_up_to_a_limit() -> None:
    assert counted(samples=10.0) == pytest.approx(10.0)
    assert counted(samples=50.0) == pytest.approx(C.samples)


def test_resampling_blur_and_speed_lower_the_limit_each() -> None:
    assert counted(samples=50.0, blur=0.5) == pytest.approx(C.samples / (1.0 + 0.5 * C.blur_cost))
    assert counted(samples=50.0, speed=2.0) == pytest.approx(C.samples / (1.0 + 2.0 * C.speed_cost))
    assert counted(samples=50.0, speed=2.0, blur=0.5) == pytest.approx(
        C.samples / (1.0 + 0.5 * C.blur_cost + 2.0 * C.speed_cost)
    )


def test_what_another_surface_hid_counts_by_its_share() -> None:
    assert counted(surface=0.25) == pytest.approx(2.5)
    assert counted(surface=0.0) == 0.0


def test_a_sample_weighs_its_confidence_among_the_samples_that_count() -> None:
    blend = decided(present(confidence=0.5), remembered(samples=10.0))
    assert float(blend.weight) == pytest.approx(0.5 / 10.5)
    assert float(decided(present(confidence=0.5), remembered(samples=0.0)).weight) == pytest.approx(1.0)


@pytest.mark.parametrize(("mean", "change"), [(0.4, 0.0), (0.37, 0.3306), (0.63, 0.1282), (0.2, 1.0)])
def test_a_mean_that_moves_beyond_deviation_and_its_own_share_is_a_change_of_light(
    mean: float, change: float
) -> None:
    """Noise is 0.53 of the larger deviation, a tenth of the larger mean, and one step of eight bits."""
    noise = C.change_deviation * 0.1 + C.change_relative * max(0.5, mean) + 0.004
    by_hand = min(max((abs(0.5 - mean) / noise - 1.0) / C.change_ramp, 0.0), 1.0)
    assert change == pytest.approx(by_hand, abs=1e-3)
    assert float(RULES.change_of_light(plane(0.5, 0.1), plane(mean, 0.05))) == pytest.approx(change, abs=1e-3)
    assert float(RULES.change_of_light(plane(0.5, 0.05), plane(mean, 0.1))) == pytest.approx(change, abs=1e-3)
    assert counted(mean=mean) == pytest.approx(10.0 * (1.0 - change), abs=1e-2)


@pytest.mark.parametrize(
    ("speed", "gamma"), [(0.0, C.gamma_still), (5.0, None), (10.0, C.gamma_moving), (30.0, C.gamma_moving)]
)
def test_the_box_is_narrower_in_motion(speed: float, gamma: float | None) -> None:
    """Without spread over time; the history of luma 0.9 is cut towards the mean, 0.4."""
    half = 0.2 * (gamma if gamma is not None else 0.5 * (C.gamma_still + C.gamma_moving))
    blend = decided(present(), remembered(luma=0.9, speed=speed, power=0.0))
    assert float(blend.history[0, 0]) == pytest.approx(0.4 + half, rel=1e-3)


def test_the_box_is_wider_by_the_spread_over_time_where_light_has_not_changed() -> None:
    wide = decided(present(), remembered(luma=2.0, power=0.16)).history[0, 0]
    assert float(wide) == pytest.approx(0.4 + C.gamma_still * 0.2 + C.gamma_time * 0.4, rel=1e-3)
    changed = decided(present(), remembered(luma=2.0, power=0.16, mean=0.1)).history[0, 0]
    assert float(changed) == pytest.approx(0.4 + C.gamma_still * 0.2, rel=1e-3)


def test_samples_are_forgotten_as_the_history_lies_outside_the_box() -> None:
    half = C.gamma_still * 0.2
    for out, kept in ((1.0, 1.0), (1.5, 1.0 - 0.5 * C.forget), (2.0, 1.0 - C.forget), (9.0, 0.0)):
        assert counted(luma=0.4 + out * half, power=0.0) == pytest.approx(10.0 * kept, abs=0.02)


def test_a_flash_keeps_the_history_where_contrast_rises_and_light_has_not_changed() -> None:
    """Deviation is 0.05 in the history."""
    risen = present(shade=(0.5, 0.1))
    history = remembered(samples=10.0, surface=0.5)
    assert not decided(risen, history).unconfirmed
    blend = decided(risen, history, flash=1.0)
    assert blend.unconfirmed
    assert float(blend.kept) == pytest.approx(5.0)
    assert not decided(present(shade=(0.5, 0.05)), history, flash=1.0).unconfirmed
    assert decided(present(shade=(0.5, 0.05)), history, flash=2.0).unconfirmed, "of a frame like the last one"
    assert not decided(risen, remembered(mean=0.1), flash=1.0).unconfirmed


def lights(*contrasts: float) -> list[bool]:
    """Whether each of these frames, of so much mean square deviation, is a flash."""
    light, found = torch.zeros(1, 4), []
    for contrast in contrasts:
        light = light_after(torch.tensor([[0.3, contrast]]), light, torch.ones(1))
        found.append(bool(light[0, 3]))
    return found


def test_contrast_over_that_of_previous_frames_is_a_flash_for_two_frames_at_most() -> None:
    assert lights(0.01, 0.013, 0.016) == [False] * 3
    assert lights(0.01, 0.01, 0.02, 0.01, 0.01) == [False, False, True, False, False]
    assert lights(0.01, 0.01, 0.02, 0.02, 0.02, 0.02) == [False, False, True, True, False, False]


def test_smooth_extrapolated_frames_between_shaded_ones_make_no_flash_of_these() -> None:
    assert lights(*[0.01, 0.004] * 3, 0.004, 0.01) == [False] * 8


def test_contrast_is_compared_at_the_exposure_of_this_frame() -> None:
    """Luma 0.3 toned, at twice the exposure: the curve's slope there is 2 / 1.3^2."""
    light = torch.tensor([[0.3, 0.01, 0.01, 0.0]])
    at_twice = 0.01 * (2.0 / 1.3**2) ** 2
    for factor, flash in ((1.2, 0.0), (1.4, 1.0)):
        now = torch.tensor([[0.4, factor * at_twice]])
        assert float(light_after(now, light, torch.full((1,), 2.0))[0, 3]) == flash


def finished(
    history: WarpedHistory,
    *,
    samples: float,
    weight: float = 0.2,
    spreads: float = 1.0,
    confidence: float = 0.5,
    around: float = 0.0,
    fit: float = 0.0,
) -> tuple[float, float, float]:
    """Toned luma of the image, count and power.

    `around` is the mean luma around the sample of 0.5; the plane, as far as it fits, is at 0.4.
    """
    blend = Blend(
        plane(0.2, 0.0, 0.0),
        plane(weight),
        plane(samples),
        plane(spreads),
        plane(spreads),
        plane(samples),
        torch.zeros(1, 1, 1, 1, dtype=torch.bool),
    )
    current = present(confidence, shade=(around, 0.1), fit=fit)
    image, state = RULES.finish(current, history, blend, torch.tensor([2.0]), plane(0.0))
    green = float(image[0, 1] * 2.0)
    return green / (1.0 + green), float(state[0, 0]), float(state[0, 1])


def test_a_settled_history_takes_the_samples_near_a_pixel_and_a_young_one_the_frame() -> None:
    history = remembered(luma=0.2)
    assert finished(history, samples=4.0)[0] == pytest.approx(0.2 + 0.2 * (0.5 - 0.2), rel=1e-4)
    young = 0.3 + 0.5 * (0.5 - 0.3)
    assert finished(history, samples=0.5 * C.settled)[0] == pytest.approx(0.2 + 0.2 * (young - 0.2), rel=1e-4)
    assert finished(history, samples=0.5e-3)[0] == pytest.approx(0.3, rel=1e-4)


def test_the_count_grows_by_the_confidence() -> None:
    assert finished(remembered(), samples=4.0)[1] == pytest.approx(4.5)


@pytest.mark.parametrize(
    ("luma", "off"), [(0.4, 0.1), (0.6, 0.1), (0.1, 0.1 + C.spread_step), (0.9, 0.1 + C.spread_step)]
)
def test_the_spread_follows_how_far_samples_are_off_by_no_more_than_a_step(luma: float, off: float) -> None:
    """A mean over spread_samples of squares of sample - history, 0.5 - `luma`; the spread so far is 0.1."""
    for samples in (4.0, 100.0):
        rate = 0.5 / (min(samples, C.spread_samples) + 0.5)
        power = finished(remembered(luma=luma, power=0.01), samples=samples)[2]
        assert power == pytest.approx(0.01 + rate * (off**2 - 0.01), rel=1e-4)


@pytest.mark.parametrize("around", [0.45, 0.55])
def test_a_sample_like_those_around_it_does_not_widen_the_spread(around: float) -> None:
    """However far it is off the history, 0.1: it is off by the 0.05 to the mean around it."""
    rate = 0.5 / (4.0 + 0.5)
    power = finished(remembered(luma=0.1, power=0.01), samples=4.0, around=around)[2]
    assert power == pytest.approx(0.01 + rate * (0.05**2 - 0.01), rel=1e-4)


@pytest.mark.parametrize(("around", "off"), [(0.0, 0.1), (0.45, 0.05)])
def test_a_sample_like_the_plane_of_those_around_it_does_not_widen_the_spread(
    around: float, off: float
) -> None:
    rate = 0.5 / (4.0 + 0.5)
    power = finished(remembered(luma=0.1, power=0.01), samples=4.0, around=around, fit=1.0)[2]
    assert power == pytest.approx(0.01 + rate * (off**2 - 0.01), rel=1e-4)


def test_without_a_history_or_in_another_light_there_is_no_spread() -> None:
    assert finished(remembered(), samples=0.5e-3)[2] == 0.0
    assert finished(remembered(), samples=4.0, spreads=0.0)[2] == 0.0


@pytest.mark.parametrize(
    ("ycocg", "toned"), [((0.4, 0.2, -0.3), (0.9, 0.1, 0.5)), ((0.3, 0.0, -0.4), (0.7, 0.0, 0.7))]
)
def test_the_image_is_exposed_back_and_never_negative(
    ycocg: tuple[float, float, float], toned: tuple[float, float, float]
) -> None:
    blend = Blend(
        plane(*ycocg),
        plane(0.0),
        plane(4.0),
        plane(1.0),
        plane(1.0),
        plane(4.0),
        torch.zeros(1, 1, 1, 1, dtype=torch.bool),
    )
    image, *_ = RULES.finish(present(), remembered(), blend, torch.tensor([4.0]), plane(0.0))
    torch.testing.assert_close(image, ops.inverse_tone(plane(*toned)) / 4.0, rtol=1e-3, atol=1e-6)
