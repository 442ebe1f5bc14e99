"""`supersampler train`. Torch is imported when the command runs, not for --help."""

from __future__ import annotations

import signal
from contextlib import suppress
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from supersampler.cli.arguments import folder_path
from supersampler.cli.terminal import Terminal, counted
from supersampler.errors import ArgumentError, did_you_mean
from supersampler.io.files import FolderLock, check_ours, remove_partial_files
from supersampler.methods.registry import listed_methods, methods

if TYPE_CHECKING:
    from types import FrameType

    from supersampler_model.data.dataset.storage import Split
    from supersampler_model.training.trainer import Trainer, Update
    from supersampler_model.training.validation import Validated

app = typer.Typer(help="Train a method that learns.", add_completion=False, rich_markup_mode=None)
_LEARNED = {name: spec for name, spec in methods().items() if spec.task}
_CONSOLE = Terminal(stderr=True)
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
WEIGHTS = "weights.safetensors"  # in the folder of a run


@app.command()
def train(  # noqa: PLR0913  # options of a command
    context: typer.Context,
    name: Annotated[str, typer.Argument(metavar="METHOD", help=f"{listed_methods(_LEARNED.values())}.")],
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="FOLDER", parser=folder_path, help="Folder of the run."),
    ],
    data: Annotated[list[Path] | None, typer.Option(help="Training set; may be repeated.")] = None,
    shot: Annotated[list[Path] | None, typer.Option(help="Shot with references; may be repeated.")] = None,
    validation_shot: Annotated[
        list[Path] | None, typer.Option(help="Shot to validate on; may be repeated.")
    ] = None,
    steps: Annotated[int, typer.Option(min=1, help="Updates of the weights.")] = 12000,
    size: Annotated[int, typer.Option(help="Width and height of the crops in display pixels.")] = 128,
    batch: Annotated[int, typer.Option(min=1, help="Crops per update.")] = 8,
    frames: Annotated[int, typer.Option(min=1, help="Consecutive frames in a crop.")] = 4,
    rate: Annotated[float, typer.Option(help="Peak learning rate.")] = 6e-3,
    every: Annotated[int, typer.Option(min=1, help="Updates between validations and checkpoints.")] = 500,
    seed: Annotated[int, typer.Option(min=0, help="Seed of weights and crops.")] = 0,
    workers: Annotated[
        int, typer.Option(min=0, help="Processes that cut crops ahead; the crops are the same.")
    ] = 0,
    attributions: Annotated[
        Path | None, typer.Option(help="Text file with the attributions that the data requires, one a line.")
    ] = None,
    init: Annotated[
        str | None, typer.Option(help="Initial weights: a file of another run, or `shipped`.")
    ] = None,
) -> None:
    """Train a method that learns. The same command resumes a stopped run.

    \b
    Examples:
      supersampler train classifier --data data -o run
      supersampler train classifier --shot kitchen --init shipped -o kitchen-run --rate 1e-3
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    if name not in _LEARNED:
        hint = did_you_mean(name, _LEARNED)
        raise ArgumentError("METHOD", got=name, want=f"one of {', '.join(_LEARNED)}", hint=hint)
    import torch

    from supersampler.io.shot import open_source
    from supersampler_model.data.dataset.storage import open_dataset
    from supersampler_model.methods.base import load_trained, shipped_weights
    from supersampler_model.training.datasets import dataset_of_shots
    from supersampler_model.training.run_log import TABLE, read_log
    from supersampler_model.training.task import start_task
    from supersampler_model.training.trainer import CHECKPOINT, Trainer, TrainingPlan
    from supersampler_model.training.validation import validate, validation_entries

    torch.manual_seed(seed)
    _check_free(output)
    read_log(output)  # fails before the updates, not after them
    authors = [] if attributions is None else _lines(attributions)
    lock = context.with_resource(FolderLock(output))  # until the command ends
    lock.take_new()
    remove_partial_files(output, {CHECKPOINT, WEIGHTS, TABLE}.__contains__)
    datasets = [open_dataset(folder) for folder in data or []]
    for paths, split in ((shot, "train"), (validation_shot, "validation")):
        if paths:
            shots = [open_source(path) for path in paths]
            datasets.append(dataset_of_shots(shots, output / f"{split}-shots", cast("Split", split)))
    for dataset in datasets:
        given = dataset.entries("train")
        done, total = sum(map(dataset.complete, given)), sum(entry.spec.frames for entry in given)
        if done < total:
            text = f"{dataset.folder}: only {done} of {total} training frames are rendered, and are read."
            _CONSOLE.print(text, soft_wrap=True)
    unused = [one.folder for one in datasets if not (one.entries("train") or one.entries("validation"))]
    if unused or not any(dataset.entries("train") for dataset in datasets):
        got = "not given, nor is --shot"
        if data:
            got = f"{', '.join(map(str, unused or data))}, without training sequences"
        raise ArgumentError("--data", got=got, want="a training set or a shot to learn from")
    if init == "shipped" and not _LEARNED[name].weights:
        raise ArgumentError("--init", got=repr(init), want=f"a file, as no weights ship for {name}")
    start = shipped_weights(name) if init == "shipped" else init and Path(init)
    task = start_task(name, load_trained(start) if start else None)
    learned = task.method.provenance
    initial = {key: learned[key] for key in ("steps", "commit", "data") if key in learned}
    plan = TrainingPlan(steps=steps, size=size, batch=batch, frames=frames, rate=rate, seed=seed)
    trainer = Trainer(task, datasets, plan, output, workers=workers, initial=initial, attributions=authors)
    if initial not in ({}, trainer.initial):
        _CONSOLE.print(
            "--init is ignored: the run in this folder has begun with other weights.", soft_wrap=True
        )
    if trainer.frames_before != trainer.frames:
        _CONSOLE.print(
            f"The training set had {trainer.frames_before} frames when the run stopped, and has "
            f"{trainer.frames} now: crops, and thus weights, are not those of an uninterrupted run.",
            soft_wrap=True,
        )
    _warn_of_other_ratios(trainer)
    entries = validation_entries(trainer.datasets, task.ratios)
    if not trainer.done:
        trainer.save()  # the folder is then this run's, and the disk takes a checkpoint
    baseline = validate(task.baseline.eval(), entries, task.runner) if entries else None
    _warn_without_scores(trainer, baseline)
    updates: list[Update] = []
    # a run that was stopped in its last validation has all updates, but not their weights
    while trainer.done < plan.steps or trainer.done > _steps_of_weights(output):
        update_and_save(trainer, min((trainer.done // every + 1) * every, plan.steps), updates)
        found = validate(trainer.average.eval(), entries, task.runner) if entries else None
        _report(trainer, output, updates, found, baseline)
        updates.clear()


def update_and_save(trainer: Trainer, until: int, updates: list[Update]) -> None:
    """Train up to `until` updates in total, save, and append to `updates`; show progress.

    Raises:
        typer.Exit: after Ctrl-C, once the update in progress is saved.
    """
    with counted(_CONSOLE, "training", trainer.plan.steps, trainer.done) as advance:

        def count(update: Update) -> None:
            updates.append(update)
            if not stop.requested:  # afterwards, `tee` may have ended, too
                advance()

        with StopRequest() as stop:
            trainer.run(until, on_update=count, stops=lambda: stop.requested)
            trainer.save()
    if stop.requested and trainer.done < trainer.plan.steps:
        _CONSOLE.print(f"Stopped after {trainer.done} updates. Run the same command to resume.")
        raise typer.Exit(130)


class StopRequest:
    """Context manager that records the first SIGINT or SIGTERM; the second one raises KeyboardInterrupt.

    A signal that is ignored, as in a script's background, stays ignored.

    Attributes:
        requested: whether a signal was received. The trainer then finishes and saves the current update.
    """

    def __init__(self) -> None:
        self.requested = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> StopRequest:
        heard = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
        self._before = {number: signal.signal(number, self._stop) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def _stop(self, _number: int, _frame: FrameType | None) -> None:
        self.requested = True
        for number in self._before:
            signal.signal(number, signal.default_int_handler)
        # The pipe may be closed, and the console may be in the middle of another message.
        with suppress(OSError, RuntimeError, SystemExit):
            _CONSOLE.print("Stopping after this update. Ctrl-C again stops at once, without saving.")


def _steps_of_weights(output: Path) -> int:
    """Return the updates of the weights in the folder of a run; 0 if there are none."""
    from supersampler_model.methods.base import load_trained

    path = output / WEIGHTS
    return int(load_trained(path).facts.get("steps", 0)) if path.exists() else 0


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise ArgumentError("--attributions", got=f"{path} ({error})", want="a text file in UTF-8") from error


def _check_free(output: Path) -> None:
    """Raise if the folder has files that a run writes, but no checkpoint.

    Raises:
        ShotError: names the file.
    """
    from supersampler_model.training.run_log import FILES as LOG_FILES
    from supersampler_model.training.trainer import CHECKPOINT

    if not (output / CHECKPOINT).exists():  # the checkpoint is written first, and checked when it is read
        for name in (WEIGHTS, *LOG_FILES):
            check_ours(output / name, lambda _: False, "of a run in this folder: it has no checkpoint")


def _warn_of_other_ratios(trainer: Trainer) -> None:
    """Say how many sequences of each set are left out because the method does not support their ratio."""
    low, high = trainer.task.ratios
    for dataset in trainer.datasets:
        entries = [*dataset.entries("train"), *dataset.entries("validation")]
        if others := sum(not entry.within((low, high)) for entry in entries):
            what = f"{others} of {len(entries)} sequences are not read"
            why = f"{trainer.method.name} takes ratios from {low:g} to {high:g}"
            _CONSOLE.print(f"{dataset.folder}: {what}: {why}.", soft_wrap=True)


def _warn_without_scores(trainer: Trainer, baseline: Validated | None) -> None:
    """Warn that there are no validation scores if validation sequences are given, and none has a score."""
    from supersampler_model.training.validation import WARM_UP

    low, high = trainer.task.ratios
    given = any(dataset.entries("validation") for dataset in trainer.datasets)
    if given and not (baseline and baseline.scores):
        why = f"a reference after the first {WARM_UP} frames, and a ratio from {low:g} to {high:g}"
        text = f"There are no validation scores: no complete validation sequence has {why}."
        _CONSOLE.print(text, soft_wrap=True)


def _report(
    trainer: Trainer, output: Path, updates: list[Update], found: Validated | None, baseline: Validated | None
) -> None:
    """Write the weights and the log; print the scores."""
    from supersampler_model.methods.base import save_trained
    from supersampler_model.training.run_log import write_log

    scores, name = {**found.scores, **found.overlap} if found else {}, trainer.task.baseline.name
    baselines = {f"{key}_{name}": score for key, score in baseline.scores.items()} if baseline else {}
    means = {key: mean(u.losses[key] for u in updates) for key in updates[0].losses} if updates else {}
    save_trained(output / WEIGHTS, trainer.trained(scores))
    values = {**means, **scores, **baselines}
    write_log(output, trainer.done, values, found.image if found else None)
    line = ", ".join(f"{key} {value:.3f}" for key, value in values.items())
    speed = f", {mean(update.seconds for update in updates):.2f} s per update" if updates else ""
    _CONSOLE.print(f"{trainer.done}/{trainer.plan.steps}{speed}: {line}", soft_wrap=True)
