"""A training run that is stopped and resumed, for the tests of each task."""

from collections.abc import Callable
from pathlib import Path

import torch

from supersampler_model.training.trainer import Trainer


def assert_resumes_exactly(trainer: Callable[[Path], Trainer], folder: Path) -> None:
    """Check that a run stopped after three updates ends with the weights of one that is not stopped.

    Args:
        trainer: makes the run in a folder, which need not exist.
        folder: for the folders of the runs.
    """
    whole = trainer(folder / "whole")
    whole.run()
    first = trainer(folder / "parts")
    first.run(until=3)
    first.save()
    second = trainer(folder / "parts")
    assert second.done == 3
    second.run()
    for name, value in whole.method.state_dict().items():
        assert torch.equal(value, second.method.state_dict()[name]), name
    for name, value in whole.average.state_dict().items():
        assert torch.equal(value, second.average.state_dict()[name]), name
