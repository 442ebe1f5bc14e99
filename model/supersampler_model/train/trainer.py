"""The training of the classifier: truncated back-propagation through time along streams of crops.

Each of a batch's streams walks through one crop of one sequence after the other; the history it leaves is
handed on from one update to the next, so that the network learns on the histories that it makes itself.
"""

import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch import distributed as dist

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.data.labels import Ghost
from supersampler_model.method import Size
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_buffers import History
from supersampler_model.sampling import Extent, View
from supersampler_model.train.checkpoint import (
    assets,
    data_hash,
    load_checkpoint,
    save_checkpoint,
    source_commit,
)
from supersampler_model.train.losses import LossWeights, class_loss, picture_loss, shown
from supersampler_model.train.optimizer import Muon
from supersampler_model.train.rollout import State, detached, first_state, step
from supersampler_model.train.shots import UNKNOWN
from supersampler_model.train.windows import Place, Sample, Stream, on
from supersampler_model.trained import Trained


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
        losses: weights of the loss's terms.
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
    losses: LossWeights = field(default_factory=LossWeights)


class Update(NamedTuple):
    """What one update was like."""

    picture: float
    classes: float
    seconds: float


class Trainer:
    """A run in a folder, from its checkpoint on where there is one.

    Args:
        method: is trained.
        datasets: what on.
        plan: how.
        folder: holds the checkpoint and the log.

    Raises:
        ArgumentError: nothing can be trained on, the batch does not divide among the processes, or the
            folder holds a run of other data, another method or another plan.
    """

    def __init__(self, method: Classifier, datasets: Sequence[Dataset], plan: Plan, folder: Path) -> None:
        self.plan, self.folder = plan, folder
        self.device = _device()
        self.method = method.to(self.device)
        self.datasets = list(datasets)
        self.rank, self.world = (dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else (0, 1)
        self.optimizer = Muon(self.method.parameters(), rate=plan.rate, decay=plan.decay)
        self.average = type(method)(method.config)
        self.average.load_state_dict(method.state_dict())  # stays in memory of the processor, to be validated
        self.done = 0
        count = plan.batch // self.world
        if count * self.world != plan.batch or not count:
            want = f"a multiple of {self.world}, the number of processes"
            raise ArgumentError("batch", got=plan.batch, want=want)
        self._streams = [self._stream(i) for i in range(count)]
        self._walks: list[Iterator[Sample]] = [iter(s) for s in self._streams]
        self._states: Sequence[State | None] = [None] * count
        self._off: Tensor | None = None
        path = folder / f"checkpoint-{self.rank}.pt"
        if path.exists():
            self._load(path)

    def run(self, until: int | None = None, *, on_update: Callable[[Update], None] = lambda _: None) -> None:
        """Update until `until`, the plan's end if None."""
        while self.done < (self.plan.steps if until is None else min(until, self.plan.steps)):
            started = time.perf_counter()
            picture, classes = self._update()
            self.done += 1
            on_update(Update(picture, classes, time.perf_counter() - started))

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
                "states": [None if s is None else _plain(s) for s in self._states],
                "off": self._off,
                "commit": source_commit(),
                **self._made_of(),
            },
        )

    def _made_of(self) -> dict[str, Any]:
        """What must be as it was for a run to go on."""
        return {
            "name": self.method.name,
            "config": asdict(self.method.config),
            "plan": asdict(self.plan),
            "data": data_hash(self.datasets),
        }

    def trained(self, facts: Mapping[str, Any]) -> Trained:
        """Return the averaged weights, and where they come from."""
        return Trained(
            self.method.name,
            asdict(self.method.config),
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
        self._states = [None if s is None else _state(s, self.device) for s in content["states"]]
        self._off = None if content["off"] is None else content["off"].to(self.device)

    def _stream(self, index: int) -> Stream:
        return Stream(
            self.datasets,
            ratios=self.method.ratios,
            size=self.plan.size,
            seed=[self.plan.seed, self.rank, index],
        )

    def _update(self) -> tuple[float, float]:
        """One step of the optimizer."""
        self.method.train(self.done < (1.0 - self.plan.settle) * self.plan.steps)
        for group in self.optimizer.param_groups:
            group["lr"] = self._rate()
        pictures = classes = torch.zeros((), device=self.device)
        for _ in range(self.plan.frames):
            picture, classified = self._frame()
            pictures, classes = pictures + picture, classes + classified
        loss = (pictures + classes) / self.plan.frames
        self.optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        self._share_gradients()
        torch.nn.utils.clip_grad_norm_(self.method.parameters(), 1.0)
        self.optimizer.step()
        self._keep_average()
        self._states = [state and detached(state) for state in self._states]
        self._off = None if self._off is None else self._off.detach()
        return pictures.item() / self.plan.frames, classes.item() / self.plan.frames

    def _frame(self) -> tuple[Tensor, Tensor]:
        """Step all streams by one frame."""
        samples = [on(self.device, next(walk)) for walk in self._walks]
        known = [None if s.reset else state for s, state in zip(samples, self._states, strict=True)]
        fresh = torch.tensor([state is None for state in known], device=self.device)
        states = [state or first_state(self.method, s) for s, state in zip(samples, known, strict=True)]
        drawn, self._states = step(self.method, samples, states)
        exposure = torch.cat([s.exposure for s in samples])
        off = shown(drawn.images, exposure) - shown(torch.cat([s.reference for s in samples]), exposure)
        ghost = torch.cat([s.ghost for s in samples])
        ghost = torch.where((drawn.off_screen[:, 0] > 0.0) & (ghost < UNKNOWN), Ghost.VISIBILITY, ghost)
        alias = torch.cat([s.alias for s in samples])
        before = (
            None if self._off is None else torch.where(fresh[:, None, None, None], off.detach(), self._off)
        )
        self._off = off
        useless = ((ghost == Ghost.VISIBILITY) | (ghost == Ghost.SHADING)).float()[:, None]
        weights = self.plan.losses
        return picture_loss(off, before, useless, weights), class_loss(drawn.logits, ghost, alias, weights)

    def _rate(self) -> float:
        warm = max(self.plan.steps // 50, 1)
        if self.done < warm:
            return self.plan.rate * (self.done + 1) / warm
        gone = (self.done - warm) / max(self.plan.steps - warm, 1)
        return self.plan.rate * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * gone)))

    def _share_gradients(self) -> None:
        if self.world == 1:
            return
        gradients = [p.grad for p in self.method.parameters() if p.grad is not None]
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


def _plain(state: State) -> dict[str, Any]:
    view = state.view
    return {
        "history": [t.detach() for t in state.history],
        "view": [list(view.display), list(view.extent), view.jitter],
    }


def _state(content: dict[str, Any], device: torch.device) -> State:
    display, extent, jitter = content["view"]
    history = History(*(tensor.to(device) for tensor in content["history"]))
    return State(history, View(Size(*display), Extent(*extent), jitter.to(device)))


def _device() -> torch.device:
    """This process's GPU, where there is one."""
    if not torch.cuda.is_available():
        return torch.device("cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", 0)))
