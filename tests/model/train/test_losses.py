"""Losses of training: values of each term, compared with numbers computed by hand, and their gradients."""

import math

import pytest
import torch
from torch import Tensor

from supersampler_model import ops
from supersampler_model.training.losses import (
    ClassifierWeights,
    ImageWeights,
    class_fractions,
    class_loss,
    display_values,
    dissimilarity,
    image_loss,
)

CLASSES = ClassifierWeights()
EVEN = torch.ones(1, 1, 8, 8)


def test_pixels_without_truth_cost_nothing_and_have_no_gradient() -> None:
    off = torch.full((1, 3, 8, 8), 0.1, requires_grad=True)
    holes = torch.zeros(1, 1, 8, 8, dtype=torch.bool)
    holes[:, :, 2:5] = True
    known = torch.where(holes, torch.nan, off)
    image_loss(known, known.detach(), EVEN, CLASSES).backward()  # type: ignore[no-untyped-call]
    assert off.grad is not None
    assert off.grad.isfinite().all()
    assert not off.grad[:, :, 2:5].any()


@pytest.mark.parametrize("unknown", [3, 255])
def test_pixels_of_no_known_class_are_left_out(unknown: int) -> None:
    ghost = torch.zeros(1, 8, 8, dtype=torch.int64)
    logits = torch.randn(1, 6, 4, 4)
    known = class_loss(logits, ghost, ghost, CLASSES)
    ghost[:, :4] = unknown
    assert not class_fractions(ghost)[:, :, :2].any()
    upper = logits.clone()
    upper[:, :, :2] = 100.0 * torch.randn(1, 6, 2, 4)
    torch.testing.assert_close(
        class_loss(upper, ghost, ghost, CLASSES), class_loss(logits, ghost, ghost, CLASSES)
    )
    assert known.isfinite()


def sure_of(ghost: int, alias: int) -> Tensor:
    """Logits of a network that is sure of two classes everywhere."""
    logits = torch.zeros(1, 6, 4, 4)
    logits[:, ghost] = logits[:, 3 + alias] = 20.0
    return logits


def everywhere(value: int) -> Tensor:
    return torch.full((1, 8, 8), value, dtype=torch.int64)


@pytest.mark.parametrize(("ghost", "alias"), [(0, 1), (1, 2), (2, 0)])
def test_the_right_class_of_each_group_costs_nothing_and_any_other_does(ghost: int, alias: int) -> None:
    right = class_loss(sure_of(ghost, alias), everywhere(ghost), everywhere(alias), CLASSES)
    assert right < 1e-6
    others = ((alias, ghost), ((ghost + 1) % 3, alias), (ghost, (alias + 1) % 3))
    wrong = [class_loss(sure_of(g, a), everywhere(ghost), everywhere(alias), CLASSES) for g, a in others]
    assert min(wrong) > 19.0 * CLASSES.classes


@pytest.mark.parametrize(("rare", "factor"), [(4, 4.0), (1, 8.0)])
def test_a_rare_class_weighs_by_the_root_of_its_rarity_up_to_a_bound(rare: int, factor: float) -> None:
    """`rare` of 64 or 256 quads are of another class; the logits are the same everywhere."""
    ghost = (
        torch.zeros(1, 16, 16, dtype=torch.int64) if rare == 4 else torch.zeros(1, 32, 32, dtype=torch.int64)
    )
    quads = ghost.numel() // 4
    for i in range(rare):
        ghost[:, 2 * i : 2 * i + 2, :2] = 1
    logits = torch.zeros(1, 6, ghost.shape[1] // 2, ghost.shape[2] // 2)
    said = torch.tensor([2.0, 1.0, -30.0])
    logits[:, :3] = said[None, :, None, None]
    weights = ClassifierWeights(classes=1.0)
    common = (quads / (quads - rare)) ** 0.5
    costs = -said.log_softmax(0)
    mine = (quads - rare) * common * costs[0] + rare * factor * costs[1]
    expected = mine / ((quads - rare) * common + rare * factor)
    alias = torch.full_like(ghost, 255)  # unknown: no cost of its own
    torch.testing.assert_close(class_loss(logits, ghost, alias, weights), expected, rtol=1e-4, atol=1e-6)


def test_the_same_error_in_fewer_pixels_costs_more_by_its_root_mean_square() -> None:
    spread, gathered = torch.full((2, 3, 8, 8), 0.1), torch.zeros(2, 3, 8, 8)
    gathered[..., ::4] = 0.4
    weights = ImageWeights(rms=2.0, change=0.0)
    costs = [float(image_loss(off, None, 1.0, weights)) for off in (spread, gathered)]
    assert costs[0] == pytest.approx(0.1 + 2.0 * math.sqrt(0.1**2 + 1e-6), rel=1e-5)
    assert costs[1] == pytest.approx(0.1 + 2.0 * math.sqrt(0.4**2 / 4.0 + 1e-6), rel=1e-5)
    assert ImageWeights().rms > 0.0
    assert ClassifierWeights().rms > ImageWeights().rms


def test_root_mean_squares_are_of_each_crop_and_their_mean_counts() -> None:
    off = torch.zeros(2, 3, 8, 8)
    off[0] = 0.4
    cost = float(image_loss(off, None, 1.0, ImageWeights(rms=1.0, change=0.0)))
    assert cost == pytest.approx(0.2 + 0.5 * (math.sqrt(0.16 + 1e-6) + 1e-3), rel=1e-5)


def test_a_change_of_the_error_costs_by_its_weight_and_not_by_the_pixels() -> None:
    off, before = torch.full((1, 3, 8, 8), 0.1), torch.full((1, 3, 8, 8), 0.4)
    heavy = torch.full((1, 1, 8, 8), 2.0)
    cost = float(image_loss(off, before, heavy, ImageWeights(rms=0.0, change=0.5)))
    assert cost == pytest.approx(2.0 * 0.1 + 0.5 * 0.3, rel=1e-5)


def test_pixels_without_truth_are_not_counted() -> None:
    off = torch.full((1, 3, 8, 8), 0.2)
    off[..., 4:] = torch.nan
    cost = float(image_loss(off, None, 1.0, ImageWeights(rms=1.0)))
    assert cost == pytest.approx(0.2 + math.sqrt(0.04 + 1e-6), rel=1e-5)


def test_images_are_compared_exposed_toned_and_in_srgb() -> None:
    image = torch.tensor([0.0, 0.001, 0.5]).reshape(1, 3, 1, 1)
    toned = ops.tone(2.0 * image).flatten().tolist()
    expected = [0.0, 12.92 * toned[1], 1.055 * toned[2] ** (1.0 / 2.4) - 0.055]
    assert toned[1] < 0.0031308
    torch.testing.assert_close(display_values(image, torch.tensor([2.0])).flatten(), torch.tensor(expected))


def test_black_has_a_finite_gradient() -> None:
    image = torch.zeros(1, 3, 2, 2, requires_grad=True)
    display_values(image, torch.ones(1)).sum().backward()  # type: ignore[no-untyped-call]
    assert image.grad is not None
    torch.testing.assert_close(image.grad, torch.full((1, 3, 2, 2), 12.92))


def test_a_window_is_even_about_its_pixel_and_eleven_wide() -> None:
    image = torch.full((1, 3, 25, 25), 0.5)
    spark = image.clone()
    spark[..., 12, 12] = 1.0
    found = dissimilarity(spark, image)
    for turned in (found.flip(2), found.flip(3), found.transpose(2, 3)):
        torch.testing.assert_close(found, turned, rtol=0.0, atol=1e-3)
    seen = found[0, 0, 12] > 2e-3
    assert seen.nonzero().flatten().tolist() == list(range(7, 18))
    border = image.clone()
    border[..., 0, 0] = 1.0
    assert dissimilarity(border, image)[..., 0, 0] > found[..., 12, 12], "what is outside has no weight"


def test_dissimilarity_is_of_means_and_of_contrast_by_the_constants_of_ssim() -> None:
    dim, half = torch.full((1, 3, 32, 32), 0.1), torch.full((1, 3, 32, 32), 0.5)
    checks = half + 0.02 * (-1.0) ** (torch.arange(32)[:, None] + torch.arange(32))
    of_means = 1.0 - (2.0 * 0.1 * 0.2 + 0.01**2) / (0.1**2 + 0.2**2 + 0.01**2)
    of_contrast = 1.0 - 0.03**2 / (0.02**2 + 0.03**2)
    for image, truth, expected in ((2.0 * dim, dim, of_means), (checks, half, of_contrast)):
        found = dissimilarity(image, truth)[0, 0, 16, 16]
        assert float(found) == pytest.approx(expected, rel=1e-2)


def test_fractions_of_odd_sizes_are_of_the_pixels_that_are_there() -> None:
    fractions = class_fractions(torch.tensor([[[0, 1, 1], [1, 1, 0], [2, 1, 2]]]))
    assert fractions.shape == (1, 3, 2, 2)
    assert fractions[0, 1].tolist() == [[0.75, 0.5], [0.5, 0.0]]
    torch.testing.assert_close(fractions.sum(dim=1), torch.ones(1, 2, 2))
