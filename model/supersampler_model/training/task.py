"""Interface between the trainer and a method: a stream of crops, and a training step on a batch of them."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import torch
from torch import Tensor

from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method
from supersampler_model.methods.taau.model import Taau
from supersampler_model.ops.size import Size
from supersampler_model.training.crops import Place
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.sequence_runner import SequenceRunner

State = list[Tensor]
"""State of one crop between frames; the task defines the order."""


class Crop(Protocol):
    """One frame of a crop: the part that the trainer reads."""

    @property
    def exposure(self) -> Tensor:
        """(1,) exposure of the displayed image."""

    @property
    def reference(self) -> Tensor:
        """(1, 3, H, W) linear RGB, NaN where unknown."""

    @property
    def reset(self) -> bool:
        """Whether it starts a new history."""

    def on(self, device: torch.device) -> Self:
        """Return it with its tensors on `device`."""


CropT = TypeVar("CropT", bound=Crop)
CropsT = TypeVar("CropsT", bound=Crop, covariant=True)


class Crops(Protocol[CropsT]):
    """An endless stream of crops, frame by frame."""

    place: Place
    """Position that the next iteration starts from."""

    def __iter__(self) -> Iterator[CropsT]:
        """Yield frames from `place` on."""


class Stepped(NamedTuple):
    """Results of one step of n crops."""

    images: Tensor  # (n, 3, H, W) linear RGB
    states: list[State]  # of each crop
    weight: Tensor | float = 1.0  # (n, 1, H, W) of the image error
    terms: Mapping[str, Tensor] = MappingProxyType({})  # further loss terms, weighted scalars


class Task(ABC, Generic[CropT]):
    """A method and its training.

    Tasks are stateless: the trainer keeps the states of crops from frame to frame, detaches them between
    updates, and saves them.

    Attributes:
        method: the trained method.
        losses: weights of the loss terms.
    """

    method: Method
    losses: ImageWeights

    @property
    def config(self) -> dict[str, Any]:
        """Config of the method, plain data."""
        config: Any = self.method.config
        return asdict(config)

    @property
    def ratios(self) -> tuple[float, float]:
        """Minimum and maximum ratio of the validation sequences."""
        return self.method.ratios

    @property
    def baseline(self) -> Method:
        """The method that validation compares with."""
        return Taau()

    def data(self, dataset: Dataset) -> Dataset:
        """Return the data set in the form that the method is trained and validated on.

        Raises:
            ArgumentError: it lacks inputs of the method.
        """
        return dataset

    def runner(self, method: Method, display: Size) -> SequenceRunner:
        """Return a runner that validates `method` on whole sequences."""
        return SequenceRunner(method, display)

    @abstractmethod
    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Crops[CropT]:
        """Stream crops, `size` pixels square, of data sets from `data`."""

    @abstractmethod
    def first_state(self, sample: CropT) -> State:
        """Return the state before the first frame of a crop: no history."""

    @abstractmethod
    def step(self, samples: list[CropT], states: list[State]) -> Stepped:
        """Step each crop once, with the network on the whole batch."""
