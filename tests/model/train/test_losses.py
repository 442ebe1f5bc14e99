"""Properties of the image loss."""

import threading

import pytest
import torch
from torch import Tensor

from supersampler_model.training.losses import ClassifierWeights, class_fractions, class_loss, image_loss

WEIGHTS = ClassifierWeights()
EVEN = torch.ones(1, 1, 8, 8)


def loss(off: torch.Tensor, before: torch.Tensor | None = None, weight: torch.Tensor = EVEN) -> float:
    return image_loss(off, before, weight, WEIGHTS).item()


def test_an_error_that_comes_and_goes_costs_more_than_one_that_stays() -> None:
    off = torch.full((1, 3, 8, 8), 0.1)
    assert loss(off, -off) > 1.5 * loss(off, off)


def test_an_error_costs_as_much_as_its_pixel_weighs() -> None:
    off = torch.zeros(1, 3, 8, 8)
    off[:, :, 2:5] = 0.1
    heavy, elsewhere = EVEN.clone(), EVEN.clone()
    heavy[:, :, 2:5] = 1.5
    elsewhere[:, :, 6:] = 1.5
    assert loss(off, weight=heavy) > loss(off)
    assert loss(off, weight=elsewhere) == loss(off)


def test_what_has_no_truth_costs_nothing_and_pulls_nowhere() -> None:
    off = torch.full((1, 3, 8, 8), 0.1, requires_grad=True)
    holes = torch.zeros(1, 1, 8, 8, dtype=torch.bool)
    holes[:, :, 2:5] = True
    known = torch.where(holes, torch.nan, off)
    image_loss(known, known.detach(), EVEN, WEIGHTS).backward()  # type: ignore[no-untyped-call]
    assert off.grad is not None
    assert off.grad.isfinite().all()
    assert not off.grad[:, :, 2:5].any()


@pytest.mark.parametrize("unknown", [3, 255])
def test_pixels_of_no_known_class_are_left_out(unknown: int) -> None:
    ghost = torch.zeros(1, 8, 8, dtype=torch.int64)
    logits = torch.randn(1, 6, 4, 4)
    known = class_loss(logits, ghost, ghost, WEIGHTS)
    ghost[:, :4] = unknown
    assert not class_fractions(ghost)[:, :, :2].any()
    upper = logits.clone()
    upper[:, :, :2] = 100.0 * torch.randn(1, 6, 2, 4)
    torch.testing.assert_close(
        class_loss(upper, ghost, ghost, WEIGHTS), class_loss(logits, ghost, ghost, WEIGHTS)
    )
    assert known.isfinite()


def test_the_class_loss_of_two_processes_is_that_of_the_whole_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    """Class frequencies and the total weight are those of the batch, and not those of each crop."""
    both, values = threading.Barrier(2), [torch.zeros(1), torch.zeros(1)]

    def mean_of_two(value: Tensor) -> Tensor:
        values[int(threading.current_thread().name)] = value.detach()
        both.wait(timeout=20.0)
        mean = (values[0] + values[1]) / 2.0
        both.wait(timeout=20.0)  # before the next value replaces one that the other thread has yet to read
        return mean

    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(2, 6, 8, 8, generator=generator)
    classes = torch.randint(0, 3, (2, 16, 16), generator=generator)
    classes[0][classes[0] == 2] = 0  # none of it in the first process's crop
    whole, losses = class_loss(logits, classes, classes, WEIGHTS), [torch.zeros(()), torch.zeros(())]
    monkeypatch.setattr("supersampler_model.training.losses.mean_of_processes", mean_of_two)

    def run(rank: int) -> None:
        part = slice(rank, rank + 1)
        losses[rank] = class_loss(logits[part], classes[part], classes[part], WEIGHTS)

    threads = [threading.Thread(target=run, args=(rank,), name=str(rank)) for rank in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    torch.testing.assert_close((losses[0] + losses[1]) / 2.0, whole)
