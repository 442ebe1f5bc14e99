"""Exposure: given or measured, followed from frame to frame, and not moved by one frame alone."""

import math

import pytest
import torch
from hypothesis import assume, given
from hypothesis import strategies as st

from supersampler.io.display import followed_exposure, usable_exposure
from supersampler_model import ops


def test_exposure_is_given_or_measured_and_adapts() -> None:
    color, all_of_it, none = torch.full((1, 3, 4, 4), 0.5), torch.ones(1, 1, 4, 4), torch.zeros(1)
    assert abs(ops.exposure_for(color, all_of_it, torch.tensor([3.0]), none).item()) == 3.0
    measured = abs(ops.exposure_for(color, all_of_it, none, none).item())
    assert measured == pytest.approx(0.18 / 0.5)
    before = torch.tensor([measured * 8])
    adapting = ops.exposure_for(color, all_of_it, none, before).item()
    assert adapting == pytest.approx(measured * 8**0.9, rel=1e-4)


def test_exposure_looks_at_usable_pixels_only() -> None:
    color, usable, none = torch.full((1, 3, 4, 4), 0.5), torch.ones(1, 1, 4, 4), torch.zeros(1)
    color[..., 0, :], usable[..., 0, :] = 0.0, 0.0
    assert abs(ops.exposure_for(color, usable, none, none).item()) == pytest.approx(0.18 / 0.5)
    assert ops.exposure_for(color * 0, usable * 0, none, torch.tensor([0.7])).item() == pytest.approx(0.7)


def followed(luma: float, exposure: float, before: float) -> float:
    """What `exposure_for` returns of a frame of one luminance; not a number: of none that is usable."""
    usable = torch.full((1, 1, 2, 2), float(luma >= 0.0))
    color = torch.full((1, 3, 2, 2), luma).nan_to_num(0.0)
    return ops.exposure_for(color, usable, torch.tensor([exposure]), torch.tensor([before])).item()


@pytest.mark.parametrize("exposure", [1e30, 1e-40, float("inf"), 2.0**25, 2.0**-25, -1.0])
def test_an_absurd_exposure_is_measured_as_if_none_were_given(exposure: float) -> None:
    for before in (0.0, 0.5, -0.5):
        assert followed(0.5, exposure, before) == followed(0.5, 0.0, before)


@pytest.mark.parametrize(("luma", "exposure"), [(0.5, 1e4), (0.5, 1e-3), (65504.0, 0.0), (0.0, 0.0)])
def test_an_outlier_changes_the_exposure_when_a_second_frame_wants_it(luma: float, exposure: float) -> None:
    first = followed(luma, exposure, 0.3)
    assert first == pytest.approx(-0.3), "the one before holds"
    wanted = exposure or abs(followed(luma, 0.0, 0.0))
    assert followed(luma, exposure, first) == pytest.approx(wanted)
    back = followed(0.5, 0.0, first)
    assert back == pytest.approx(followed(0.5, 0.0, 0.3)), "one frame alone leaves nothing"


def test_a_first_exposure_that_the_second_frame_does_not_confirm_is_forgotten_at_once() -> None:
    first = followed(0.5, 1e4, 0.0)
    assert abs(first) == pytest.approx(1e4), "there is none before it to hold"
    assert followed(0.5, 0.0, first) == pytest.approx(0.36)


LUMAS = st.one_of(st.floats(0.0, 65504.0, width=32), st.just(float("nan")))
EXPOSURES = st.one_of(st.just(0.0), st.floats(2.0**-60, 2.0**60, width=32))
BEFORE = st.floats(2.0**-18, 2.0**11, width=32)


@given(luma=LUMAS, exposure=EXPOSURES, before=BEFORE)
def test_one_frame_moves_the_exposure_by_six_stops_at_most(
    luma: float, exposure: float, before: float
) -> None:
    after = followed(luma, exposure, before)
    limit = 6.0 if 2.0**-24 <= exposure <= 2.0**24 else 0.6  # of what is measured a tenth of the way
    assert abs(math.log2(abs(after) / before)) <= limit + 1e-3


@given(luma=LUMAS, exposure=EXPOSURES, before=BEFORE, sign=st.sampled_from([1.0, -1.0, 0.0]))
def test_runtime_and_models_follow_an_exposure_alike(
    luma: float, exposure: float, before: float, sign: float
) -> None:
    before *= sign
    target = None if math.isnan(luma) else 0.18 / max(luma, 1e-4)
    wanted = usable_exposure(exposure or None) or target
    assume(wanted is None or not before or abs(abs(math.log2(wanted / abs(before))) - 6.0) > 1e-3)
    here = followed_exposure(usable_exposure(exposure or None), target, before)
    assert followed(luma, exposure, before) == pytest.approx(here, rel=1e-4)
