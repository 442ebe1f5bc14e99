"""Training: truncated back-propagation through time along streams of crops.

Each stream of a batch yields crop after crop, frame by frame. An update starts from the histories at the end
of the previous update, so that the network is trained on its own histories.
"""

import io
import math
import pickle
import subprocess
import time
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, cast

import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from supersampler.errors import ArgumentError, SupersamplerError, shown
from supersampler.io.child_process import run
from supersampler.io.files import check_is_file, write_bytes
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.methods.base import Method, Trained
from supersampler_model.training.crops import StreamPosition
from supersampler_model.training.datasets import assets, data_hash
from supersampler_model.training.losses import display_values, image_loss
from supersampler_model.training.optimizer import Muon
from supersampler_model.training.prefetch import frames_of
from supersampler_model.training.task import State, Task

CPU = torch.device("cpu")
CHECKPOINT = "checkpoint.pt"  # in the folder of a run
VERSION = 5
_DAMAGE = (
    OSError, RuntimeError, ValueError, EOFError, LookupError, TypeError, AttributeError,
    pickle.UnpicklingError, zipfile.BadZipFile,
)  # fmt: skip
"""Errors that torch and zipfile raise for files that are not checkpoints."""
SMALLEST_CROP = 17
"""Display pixels: two pixels of a network's coarsest level, as batch normalisation needs more than one."""


@dataclass(frozen=True)
class TrainingPlan:
    """Settings of a run."""

    steps: int = 12000  # updates of the weights
    batch: int = 8  # streams
    frames: int = 4  # per update
    size: int = 128  # of the crops, display pixels
    rate: float = 6e-3  # peak learning rate, after a warm-up of 2 %; then a cosine down to a hundredth
    decay: float = 1e-4  # weight decay
    average: int = 500  # length of the moving average of the weights, updates
    settle: float = 0.3  # last fraction of the updates, with batch normalisation in evaluation mode
    seed: int = 0  # of weights and crops

    def check(self) -> None:
        """Raise an ArgumentError unless there are updates of some crops at a positive rate."""
        for name, low in (("steps", 1), ("batch", 1), ("frames", 1), ("size", SMALLEST_CROP), ("seed", 0)):
            if getattr(self, name) < low:
                raise ArgumentError(name, got=getattr(self, name), want=f"at least {low}")
        if not 0.0 < self.rate < math.inf:  # NaN fails, too
            raise ArgumentError("rate", got=self.rate, want="a finite number > 0")


class DivergedError(SupersamplerError, ArithmeticError):
    """The loss or its gradient is not finite; the weights are those of the previous update."""


class Update(NamedTuple):
    """Statistics of one update."""

    losses: dict[str, float]  # terms by name, the image loss first
    seconds: float


class Trainer:
    """A run in a folder with its checkpoint and log; it resumes from the checkpoint if there is one.

    Attributes:
        initial: provenance of the weights that the run has started with, {} for random ones.
        frames: number of training frames that are rendered.
        frames_before: number of rendered training frames when the checkpoint was written.
        attributions: attributions that the data requires; by default those of the start of the run.

    Args:
        workers: number of processes that cut crops ahead; the crops are the same with any number.

    Raises:
        ArgumentError: there is no training data, the plan is impossible, or the folder holds a run of other
            data, another method, other weights of the loss or another plan.
    """

    def __init__(
        self,
        task: Task,
        datasets: Sequence[Dataset],
        plan: TrainingPlan,
        folder: Path,
        *,
        workers: int = 0,
        initial: Mapping[str, Any] = MappingProxyType({}),
        attributions: Sequence[str] = (),
    ) -> None:
        plan.check()
        self.task, self.plan, self.folder = task, plan, folder
        self.initial, self.attributions = dict(initial), list(attributions)
        self.device = torch.device("cuda", torch.cuda.current_device()) if torch.cuda.is_available() else CPU
        mean = partial(_running_mean, plan.average)
        self._averaged = AveragedModel(task.method, CPU, mean, use_buffers=True)
        self.average = cast(Method, self._averaged.module)  # validated on the CPU
        self.method = task.method.to(self.device)
        self.datasets = [task.data(dataset) for dataset in datasets]
        self.frames = sum(d.complete(entry) for d in self.datasets for entry in d.entries("train"))
        self.frames_before = self.frames
        self.optimizer = Muon(self.method.parameters(), rate=plan.rate, decay=plan.decay)
        self.done = 0
        seeds = [[plan.seed, number] for number in range(plan.batch)]
        self._streams = [task.stream(self.datasets, size=plan.size, seed=seed) for seed in seeds]
        self._frames = frames_of(self._streams, self.device, workers)
        self._states: Sequence[State | None] = [None] * plan.batch
        self._error: Tensor | None = None
        if (folder / CHECKPOINT).exists():
            self._load(folder / CHECKPOINT)

    def run(
        self,
        until: int | None = None,
        *,
        on_update: Callable[[Update], None] = lambda _: None,
        stops: Callable[[], bool] = lambda: False,
    ) -> None:
        """Update until `until` updates are done, including those of earlier runs; None: the whole plan.

        `stops` is called before each update, and ends the run by returning True.

        Raises:
            DivergedError: a loss is not finite.
            DatasetError: a frame is damaged.
            DataError: a worker process has ended.
        """
        target = self.plan.steps if until is None else min(until, self.plan.steps)
        while self.done < target and not stops():
            started = time.perf_counter()
            losses = self._update()
            self.done += 1
            on_update(Update(losses, time.perf_counter() - started))

    def save(self) -> None:
        """Write the checkpoint; ShotError if the disk refuses."""
        content = {
            "version": VERSION,
            "done": self.done,
            "method": self.method.state_dict(),
            "average": self._averaged.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "positions": [asdict(stream.position) for stream in self._streams],
            "states": [state and [t.cpu() for t in state] for state in self._states],
            "error": None if self._error is None else self._error.cpu(),
            "commit": source_commit(),
            "initial": self.initial,
            "attributions": self.attributions,
            "frames": self.frames,
            **self._settings(),
        }
        data = io.BytesIO()
        torch.save(content, data)  # on a full disk, torch itself raises an error that names no file
        write_bytes(self.folder / CHECKPOINT, data.getvalue())

    def _settings(self) -> dict[str, Any]:
        """Return the settings that must not change for a run to resume."""
        return {
            "name": self.method.name,
            "config": self.task.config,
            "losses": asdict(self.task.losses),
            "plan": asdict(self.plan),
            "data": data_hash(self.datasets),
        }

    def trained(self, scores: Mapping[str, float]) -> Trained:
        """Return the averaged weights and their provenance, with their validation scores."""
        provenance = {
            "steps": self.done,
            "data": data_hash(self.datasets),
            "assets": assets(self.datasets),
            "commit": source_commit(),
            "validation": scores,
            "attributions": self.attributions,
            "init": self.initial,
        }
        weights = self.average.state_dict().items()
        tensors = {name: value.detach().cpu().contiguous() for name, value in weights}
        return Trained(self.method.name, self.task.config, provenance, tensors)

    def _load(self, path: Path) -> None:
        content = load_checkpoint(path)
        for name, value in self._settings().items():
            if (before := content.get(name)) != value:
                fields = before.items() if isinstance(before, dict) and isinstance(value, dict) else ()
                other = ", ".join(f"{key} {old}" for key, old in fields if value.get(key) != old)
                kind, other = ("method", str(before)) if name == "name" else (name, other)
                got = f"{path}, of another {kind}{f' ({other})' if other else ''}"
                raise ArgumentError("checkpoint", got=got, want=f"the run's own {kind}, or a new folder")
        try:
            self._resume(content)
        except (LookupError, TypeError, ValueError, AttributeError, RuntimeError) as error:
            got = f"{path}, with another content ({shown(error)})"
            raise ArgumentError(
                "checkpoint", got=got, want="one that training wrote, or a new folder"
            ) from error

    def _resume(self, content: dict[str, Any]) -> None:
        """Take over the state in a checkpoint; other errors than ArgumentError mean that it is damaged."""
        self.done = content["done"]
        if type(self.done) is not int or not 0 <= self.done <= self.plan.steps:
            raise ValueError(f"{shown(self.done)} updates of {self.plan.steps}")
        self.initial = dict(content.get("initial", self.initial))  # older checkpoints lack these three
        self.attributions = self.attributions or list(content.get("attributions", []))
        self.frames_before = int(content.get("frames", self.frames))
        self.method.load_state_dict(content["method"])
        self._averaged.load_state_dict(content["average"])
        self.optimizer.load_state_dict(content["optimizer"])
        for stream, position in zip(self._streams, content["positions"], strict=True):
            stream.position = StreamPosition(**position)
        states, error = content["states"], content["error"]
        if len(states) != len(self._streams):
            raise ValueError(f"{len(states)} states of {len(self._streams)} streams")
        self._states = [state and [t.to(self.device) for t in state] for state in states]
        self._error = None if error is None else error.to(self.device)

    def _update(self) -> dict[str, float]:
        """Take a step of the optimizer; return the terms of the loss."""
        self.method.train(self.done < (1.0 - self.plan.settle) * self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self._rate()
        frames = [self._frame() for _ in range(self.plan.frames)]
        terms = {name: ops.sum_of([frame[name] for frame in frames]) for name in frames[0]}
        loss = ops.sum_of(list(terms.values())) / self.plan.frames
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self.method.parameters(), 1.0)
        if not torch.isfinite(loss.detach() + norm):
            text = (
                f"the loss of update {self.done + 1} is {loss.item():g}, its gradient's norm {norm.item():g}"
            )
            hint = "Use a lower learning rate in another folder, and look for NaN and infinity in the data."
            raise DivergedError(f"{text}; want finite numbers. {hint}")
        self.optimizer.step()
        self._averaged.update_parameters(self.method)
        self._states = [state and [t.detach() for t in state] for state in self._states]
        self._error = None if self._error is None else self._error.detach()
        values = torch.stack([*terms.values()]).detach() / self.plan.frames
        return dict(zip(terms, values.tolist(), strict=True))

    def _frame(self) -> dict[str, Tensor]:
        """Step all streams by one frame; return the terms of the loss."""
        crops = []
        for stream, (crop, position) in zip(self._streams, next(self._frames), strict=True):
            stream.position = position
            crops.append(crop)
        known = [None if crop.reset else state for crop, state in zip(crops, self._states, strict=True)]
        fresh = torch.tensor([state is None for state in known], device=self.device)[:, None, None, None]
        pairs = zip(crops, known, strict=True)
        states = [self.task.first_state(crop) if state is None else state for crop, state in pairs]
        stepped = self.task.step(crops, states)
        self._states = stepped.states
        exposure = torch.cat([crop.exposure for crop in crops])
        reference = torch.cat([crop.reference for crop in crops])
        error = display_values(stepped.images, exposure) - display_values(reference, exposure)
        before = None if self._error is None else torch.where(fresh, error.detach(), self._error)
        self._error = error
        image = image_loss(error, before, stepped.weight, self.task.losses)
        return {"image": image, **stepped.terms}

    def _rate(self) -> float:
        warmup_steps = max(self.plan.steps // 50, 1)
        if self.done < warmup_steps:
            return self.plan.rate * (self.done + 1) / warmup_steps
        progress = (self.done - warmup_steps) / max(self.plan.steps - warmup_steps, 1)
        return self.plan.rate * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * progress)))


def _running_mean(length: int, mean: Tensor, value: Tensor, count: Tensor | int) -> Tensor:
    """Average over the last `length` updates, or all of fewer; integers are counters, and are copied."""
    return mean.lerp(value, 1.0 / min(length, int(count) + 1)) if mean.is_floating_point() else value


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint.

    Raises:
        ArgumentError: the file is not a checkpoint, or has another version.
    """
    try:
        check_is_file(path)
        with zipfile.ZipFile(path) as file:  # torch.save compresses nothing: more than the file has is a bomb
            if (size := sum(entry.file_size for entry in file.infolist())) > path.stat().st_size:
                raise ValueError(f"{path.stat().st_size} bytes that claim to hold {size}")
        content = torch.load(path, map_location="cpu", weights_only=True)
    except _DAMAGE as error:
        raise ArgumentError("checkpoint", got=f"{path}: {error}", want="one that training wrote") from error
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise ArgumentError("checkpoint", got=str(path), want=f"a checkpoint of version {VERSION}")
    return content


def source_commit() -> str:
    """Return the commit of the running code, with `+` if it was modified; `unknown` outside a repository."""
    here = Path(__file__).parent
    try:
        done = run(["git", "describe", "--always", "--dirty=+", "--abbrev=12"], folder=here, seconds=10)
        done.check_returncode()
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.decode().strip()
