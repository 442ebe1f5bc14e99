"""Interface between the trainer and a method: a stream of crops, and a training step on a batch of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

import torch
from torch import Tensor
from torch.utils import _pytree as pytree

from supersampler.methods.registry import load, methods
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.methods import learned_method
from supersampler_model.methods.base import Method, Trained
from supersampler_model.methods.taau import Taau
from supersampler_model.training.crops import CropStream
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.validation import SequenceRunner

State = list[Tensor]
"""State of one crop between frames; the task defines the order."""
Result = TypeVar("Result")
BFLOAT16 = "avx512_bf16", "amx_bf16", "bf16"
"""Torch's names of CPU instructions for bfloat16; the last one is Arm's."""


class Stepped(NamedTuple):
    """Results of one step of n crops."""

    images: Tensor  # (n, 3, H, W) linear RGB
    states: list[State]  # of each crop
    weight: Tensor | float = 1.0  # (n, 1, H, W) of the image error
    terms: Mapping[str, Tensor] = MappingProxyType({})  # further loss terms, weighted scalars


class Task(ABC):
    """A method and its training.

    Tasks are stateless: the trainer keeps the states of crops from frame to frame, detaches them between
    updates, and saves them. Like `CropFrame`, a frame of a crop is a named tuple with `exposure`, `reference`
    and `reset`.
    """

    method: Method  # to train
    losses: ImageWeights  # weights of the loss terms

    def __init__(self, method: Method) -> None:
        self.method = method

    @property
    def config(self) -> dict[str, Any]:
        """Config of the method, plain data."""
        return asdict(self.method.config)

    @property
    def ratios(self) -> tuple[float, float]:
        """Minimum and maximum ratio of the validation sequences."""
        return self.method.ratios

    @property
    def baseline(self) -> Method:
        """The method that validation compares with."""
        return Taau()

    def data(self, dataset: Dataset) -> Dataset:
        """Return the set with the sequences that the method is trained and validated on.

        Raises:
            ArgumentError: the set lacks inputs of the method.
        """
        return dataset

    def runner(self, method: Method, display: ops.Size) -> SequenceRunner:
        """Return a runner that validates `method` on whole sequences."""
        return SequenceRunner(method, display)

    @abstractmethod
    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> CropStream:
        """Stream crops of data sets from `data`, `size` pixels square."""

    @abstractmethod
    def first_state(self, crop: Any) -> State:
        """Return the state before the first frame of a crop: no history."""

    @abstractmethod
    def step(self, crops: list[Any], states: list[State]) -> Stepped:
        """Step each crop once, with the network on the whole batch."""


def fast_convolutions(device: torch.device, *, training: bool = True) -> torch.autocast:
    """Return the context of a network in training: bfloat16, or float32 on CPUs without bfloat16.

    On such CPUs, bfloat16 takes several times as long as float32.
    """
    is_fast = device.type != "cpu" or any(torch.cpu.get_capabilities().get(name) for name in BFLOAT16)
    return torch.autocast(device.type, torch.bfloat16, enabled=training and is_fast)


def in_batches(stage: Callable[..., Result], crops: Sequence[tuple[Any, ...]]) -> list[Result]:
    """Return `stage(*crop)` of each crop; crops of equal shapes run as one batch.

    A stage has hundreds of small operations, for one crop or for a batch. A batch therefore reduces overhead,
    most of all on a GPU. The arguments of a stage are tensors, and named tuples, lists and dictionaries of
    tensors. Its operations must not depend on values of tensors.
    """
    batches: dict[Any, list[int]] = {}
    found: list[list[Tensor]] = []
    for index, crop in enumerate(crops):
        tensors, structure = _split(crop)
        found.append(tensors)
        kinds = tuple((tensor.shape, tensor.dtype) for tensor in tensors)
        batches.setdefault((structure, kinds), []).append(index)
    results: dict[int, Result] = {}
    for (structure, _), members in batches.items():
        columns = zip(*(found[i] for i in members), strict=True)
        batch = _batch(stage, structure, [torch.stack(column) for column in columns])
        results |= dict(zip(members, batch, strict=True))
    return [results[index] for index in range(len(crops))]


def _batch(stage: Callable[..., Result], structure: Any, stacked: list[Tensor]) -> Iterator[Result]:
    """Yield the results of one batch, from its tensors, the crops along the first axis."""
    returned: list[Any] = []

    def run(*tensors: Tensor) -> tuple[Tensor, ...]:
        outputs, made = _split(stage(*_joined(tensors, structure)))
        returned.append(made)
        return tuple(outputs)

    outputs = torch.func.vmap(run)(*stacked)
    for tensors in zip(*(output.unbind() for output in outputs), strict=True):
        yield _joined(tensors, returned[0])


def _split(value: Any) -> tuple[list[Tensor], Any]:
    """Return the tensors of a nested structure, and a hashable description of the rest."""
    leaves, spec = pytree.tree_flatten(value)
    rest = tuple(None if isinstance(leaf, Tensor) else (leaf,) for leaf in leaves)
    return [leaf for leaf in leaves if isinstance(leaf, Tensor)], (spec, rest)


def _joined(tensors: Iterable[Tensor], structure: tuple[Any, Any]) -> Any:
    """Invert `_split`."""
    (spec, rest), given = structure, iter(tensors)
    return pytree.tree_unflatten([next(given) if leaf is None else leaf[0] for leaf in rest], spec)


def start_task(name: str, weights: Trained | None = None) -> Task:
    """Return the training task of a method.

    The initial weights are random, those of the method, or those of `classifier` if the method extends it.

    Raises:
        ArgumentError: the method does not exist or is not trainable, or the weights do not fit.
    """
    kind = learned_method(name)
    if weights is None:
        method = kind()
    elif weights.method == name:
        method = kind.of(weights)
    else:
        method = getattr(kind, "from_classifier", kind.of)(weights)
    task: Task = load(methods()[name].task)(method)
    return task
