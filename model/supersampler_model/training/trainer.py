"""The training of methods that learn: truncated back-propagation through time along streams of crops.

Each of a batch's streams walks through one crop of one sequence after the other; the history it leaves is
handed on from one update to the next, so that the network learns on the histories that it makes itself.
"""

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch import distributed as dist

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method
from supersampler_model.methods.weights_file import Trained
from supersampler_model.ops.sampling import sum_of
from supersampler_model.training.checkpoint import (
    assets,
    data_hash,
    load_checkpoint,
    save_checkpoint,
    source_commit,
)
from supersampler_model.training.crops import Place
from supersampler_model.training.losses import image_loss, shown
from supersampler_model.training.optimizer import Muon
from supersampler_model.training.task import Crop, State, Task


@dataclass(frozen=True)
class Plan:
    """What a run is made of.

    Attributes:
        steps: updates of the weights.
        batch: streams, of all processes together.
        frames: that an update looks back on.
        size: of the crops, display pixels.
        rate: highest learning rate; it warms up over the first 2 % and falls as a cosine to a hundredth.
        decay: weight decay.
        average: of the weights that are kept: 1 - 1 / this many updates.
        settle: last share of the updates, in which batch normalisation is held as it will be used.
        seed: of weights and crops.
    """

    steps: int = 12000
    batch: int = 8
    frames: int = 4
    size: int = 128
    rate: float = 6e-3
    decay: float = 1e-4
    average: int = 500
    settle: float = 0.3
    seed: int = 0


class Update(NamedTuple):
    """What one update was like."""

    losses: dict[str, float]  # terms by name, the image's first
    seconds: float


class Trainer:
    """A run in a folder, from its checkpoint on where there is one.

    Args:
        task: the method that is trained, and how one step of it is.
        datasets: what on.
        plan: how.
        folder: holds the checkpoint and the log.

    Raises:
        ArgumentError: nothing can be trained on, the batch does not divide among the processes, or the
            folder holds a run of other data, another method, other weights of the loss or another plan.
    """

    def __init__(self, task: Task[Any], datasets: Sequence[Dataset], plan: Plan, folder: Path) -> None:
        self.task, self.plan, self.folder = task, plan, folder
        self.device = _device()
        self.average: Method = deepcopy(task.method).cpu()  # where it is validated
        self.method = task.method.to(self.device)
        self.datasets = [task.data(dataset) for dataset in datasets]
        self.rank, self.world = (dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else (0, 1)
        self.optimizer = Muon(self.method.parameters(), rate=plan.rate, decay=plan.decay)
        self.done = 0
        count = plan.batch // self.world
        if count * self.world != plan.batch or not count:
            want = f"a multiple of {self.world}, the number of processes"
            raise ArgumentError("batch", got=plan.batch, want=want)
        seeds = [[plan.seed, self.rank, index] for index in range(count)]
        self._streams = [task.stream(self.datasets, size=plan.size, seed=seed) for seed in seeds]
        self._walks: list[Iterator[Crop]] = [iter(s) for s in self._streams]
        self._states: Sequence[State | None] = [None] * count
        self._off: Tensor | None = None
        path = folder / f"checkpoint-{self.rank}.pt"
        if path.exists():
            self._load(path)

    def run(self, until: int | None = None, *, on_update: Callable[[Update], None] = lambda _: None) -> None:
        """Update until `until`, the plan's end if None."""
        while self.done < (self.plan.steps if until is None else min(until, self.plan.steps)):
            started = time.perf_counter()
            losses = self._update()
            self.done += 1
            on_update(Update(losses, time.perf_counter() - started))

    def save(self) -> None:
        """Write this process's checkpoint."""
        save_checkpoint(
            self.folder / f"checkpoint-{self.rank}.pt",
            {
                "done": self.done,
                "method": self.method.state_dict(),
                "average": self.average.state_dict(),
                "optimizer": self.optimizer.state_dict(),
                "places": [asdict(s.place) for s in self._streams],
                "states": self._states,
                "off": self._off,
                "commit": source_commit(),
                **self._made_of(),
            },
        )

    def _made_of(self) -> dict[str, Any]:
        """What must be as it was for a run to go on."""
        return {
            "name": self.method.name,
            "config": self.task.config,
            "losses": asdict(self.task.losses),
            "plan": asdict(self.plan),
            "data": data_hash(self.datasets),
        }

    def trained(self, facts: Mapping[str, Any]) -> Trained:
        """Return the averaged weights, and where they come from."""
        return Trained(
            self.method.name,
            self.task.config,
            {
                "steps": self.done,
                "data": data_hash(self.datasets),
                "assets": assets(self.datasets),
                "commit": source_commit(),
                **facts,
            },
            {name: value.detach().cpu().contiguous() for name, value in self.average.state_dict().items()},
        )

    def _load(self, path: Path) -> None:
        content = load_checkpoint(path)
        changed = [name for name, value in self._made_of().items() if content[name] != value]
        if changed:
            want = f"the run's own {', '.join(changed)}, or a new folder"
            raise ArgumentError("checkpoint", got=f"{path}, of another {changed[0]}", want=want)
        self.done = content["done"]
        self.method.load_state_dict(content["method"])
        self.average.load_state_dict(content["average"])
        self.optimizer.load_state_dict(content["optimizer"])
        for stream, place in zip(self._streams, content["places"], strict=True):
            stream.place = Place(**place)
        self._states = [state and [t.to(self.device) for t in state] for state in content["states"]]
        self._off = None if content["off"] is None else content["off"].to(self.device)

    def _update(self) -> dict[str, float]:
        """One step of the optimizer; returns the terms of its loss."""
        self.method.train(self.done < (1.0 - self.plan.settle) * self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self._rate()
        frames = [self._frame() for _ in range(self.plan.frames)]
        terms = {name: sum_of([frame[name] for frame in frames]) for name in frames[0]}
        loss = sum_of(list(terms.values())) / self.plan.frames
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._share_gradients()
        torch.nn.utils.clip_grad_norm_(self.method.parameters(), 1.0)
        self.optimizer.step()
        self._keep_average()
        self._states = [state and [t.detach() for t in state] for state in self._states]
        self._off = None if self._off is None else self._off.detach()
        return {name: term.item() / self.plan.frames for name, term in terms.items()}

    def _frame(self) -> dict[str, Tensor]:
        """Step all streams by one frame; returns the terms of the loss."""
        samples = [next(walk).on(self.device) for walk in self._walks]
        known = [None if s.reset else state for s, state in zip(samples, self._states, strict=True)]
        fresh = torch.tensor([state is None for state in known], device=self.device)
        states = [
            self.task.first_state(s) if state is None else state
            for s, state in zip(samples, known, strict=True)
        ]
        stepped = self.task.step(samples, states)
        self._states = stepped.states
        exposure = torch.cat([s.exposure for s in samples])
        off = shown(stepped.images, exposure) - shown(torch.cat([s.reference for s in samples]), exposure)
        before = (
            None if self._off is None else torch.where(fresh[:, None, None, None], off.detach(), self._off)
        )
        self._off = off
        picture = image_loss(off, before, stepped.weight, self.task.losses)
        return {"picture": picture, **stepped.terms}

    def _rate(self) -> float:
        warm = max(self.plan.steps // 50, 1)
        if self.done < warm:
            return self.plan.rate * (self.done + 1) / warm
        gone = (self.done - warm) / max(self.plan.steps - warm, 1)
        return self.plan.rate * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * gone)))

    def _share_gradients(self) -> None:
        if self.world == 1:
            return
        gradients = []
        for parameter in self.method.parameters():
            if parameter.grad is None:  # crops of one process may not have met all weights
                parameter.grad = torch.zeros_like(parameter)
            gradients.append(parameter.grad)
        flat = torch.cat([g.flatten() for g in gradients])
        dist.all_reduce(flat)
        flat /= self.world
        start = 0
        for g in gradients:
            g.copy_(flat[start : start + g.numel()].view_as(g))
            start += g.numel()

    def _keep_average(self) -> None:
        share = 1.0 / min(self.plan.average, self.done + 1)
        with torch.no_grad():
            for kept, now in zip(
                self.average.state_dict().values(), self.method.state_dict().values(), strict=True
            ):
                if kept.is_floating_point():
                    kept.lerp_(now.to(kept.device), share)
                else:
                    kept.copy_(now)


def _device() -> torch.device:
    """This process's GPU, where there is one."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
