"""Short training runs, for one process or, as a program that torchrun starts, for several."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler_model.data.dataset import open_dataset
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.extrapolate import Extrapolate
from supersampler_model.methods.gbuffer import SmallGBuffer
from supersampler_model.training.classifier_tasks import ClassifierTask, ExtrapolateTask
from supersampler_model.training.gbuffer_task import GBufferTask
from supersampler_model.training.processes import join_processes, leave_processes
from supersampler_model.training.task import Task
from supersampler_model.training.trainer import Plan, Trainer

PLAN = Plan(steps=2, batch=2, frames=2, size=20, average=3, settle=0.5)
COMMAND = Plan(steps=6, batch=2, frames=2, size=20)  # as `supersampler train` has it with these options
CLASSIFIER = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))
GBUFFER = GBufferConfig(
    network=replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8), frame=8, levels=(8, 8, 8, 8))
)
WHOLE, PARTLY = "whole", "partly"
"""Names of sets with all references, and with some that are known in part."""
TASKS: dict[str, tuple[str, Callable[[], Task]]] = {
    "classifier": (PARTLY, lambda: ClassifierTask(Classifier(CLASSIFIER))),
    "extrapolate": (PARTLY, lambda: ExtrapolateTask(Extrapolate(CLASSIFIER))),
    "gbuffer": (WHOLE, lambda: GBufferTask(SmallGBuffer(GBUFFER))),
}


class FullPrecision(torch.autocast):
    """Stands in for `torch.autocast`, as bfloat16 rounds more than the tests tolerate."""

    def __init__(self, *place: Any, **settings: Any) -> None:
        super().__init__(*place, **{**settings, "enabled": False})


def trainer(name: str, data: Path, folder: Path) -> Trainer:
    """Return a run of one of TASKS in a new folder."""
    which, task = TASKS[name]
    folder.mkdir(exist_ok=True)  # by both processes
    torch.manual_seed(0)
    return Trainer(task(), [open_dataset(data / which)], PLAN, folder)


def command(data: Path, folder: Path) -> Trainer:
    """Return the run of `supersampler train classifier` with the settings of COMMAND."""
    folder.mkdir(exist_ok=True)
    torch.manual_seed(COMMAND.seed)
    return Trainer(ClassifierTask(Classifier()), [open_dataset(data / PARTLY)], COMMAND, folder)


def main(data: Path, output: Path) -> None:
    """Train `classifier` as the command does, then all of TASKS, and leave the checkpoints."""
    join_processes()
    runs = [command(data, output / "command")]
    runs[0].run()
    torch.autocast = FullPrecision  # type: ignore[misc]
    for name in TASKS:
        runs.append(trainer(name, data, output / name))
        runs[-1].run()
    for run in runs:
        run.save()
    leave_processes()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
