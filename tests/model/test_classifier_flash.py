"""Which light `classifier` does not accumulate yet."""

import torch
from torch import Tensor

from supersampler_model import ops
from supersampler_model.methods.classifier import unexplained_light
from supersampler_model.methods.classifier_inputs import WarpedHistory

DARK, LIT = 0.2, 0.8
SIZE = ops.Size(16, 8)
HISTORY = WarpedHistory(
    *(torch.full((1, 1, 8, 16), value) for value in (DARK, DARK, 0.0, DARK, 4.0, 0.0, 0.0, 0.0, 1.0, 0.0))
)
HISTORY = HISTORY._replace(range=torch.full((1, 2, 8, 16), DARK))


def spots(count: int) -> Tensor:
    luma = torch.full((1, 1, 8, 16), DARK)
    luma.view(-1)[: 5 * count : 5] = LIT
    return luma


def test_sparse_light_over_all_of_the_history_is_unexplained_where_it_is() -> None:
    luma, around = spots(4), torch.full((1, 1, 8, 16), DARK)
    assert torch.equal(unexplained_light(luma, around, HISTORY, SIZE, None), luma > DARK)


def test_a_few_bright_pixels_are_a_glint() -> None:
    assert not unexplained_light(spots(2), torch.full((1, 1, 8, 16), DARK), HISTORY, SIZE, None).any()


def test_an_area_that_comes_to_light_is_explained() -> None:
    luma = torch.full((1, 1, 8, 16), DARK)
    luma[..., 8:] = LIT
    assert not unexplained_light(luma, luma, HISTORY, SIZE, None).any()


def test_light_that_the_history_has_seen_or_that_it_cannot_know_is_explained() -> None:
    luma, around = spots(4), torch.full((1, 1, 8, 16), DARK)
    seen = HISTORY._replace(range=torch.cat([HISTORY.range[:, :1], torch.full((1, 1, 8, 16), LIT)], dim=1))
    for history in (
        seen,
        HISTORY._replace(samples=torch.zeros(1, 1, 8, 16)),
        HISTORY._replace(surface=torch.zeros(1, 1, 8, 16)),
    ):
        assert not unexplained_light(luma, around, history, SIZE, None).any()


def test_light_where_the_history_is_kept_does_not_count() -> None:
    luma, around, resting = spots(4), torch.full((1, 1, 8, 16), DARK), torch.zeros(1, 1, 8, 16)
    resting.view(-1)[5:20] = 1.0
    assert not unexplained_light(luma, around, HISTORY, SIZE, resting).any()
    assert unexplained_light(luma, around, HISTORY, SIZE, torch.zeros_like(resting)).any()
