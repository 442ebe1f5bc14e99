"""What training asks of a method that learns: one step of a batch of crops, and where these come from."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import torch
from torch import Tensor

from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method, Size
from supersampler_model.methods.taau.model import Taau
from supersampler_model.training.crops import Place
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.walk import SequenceRunner

State = list[Tensor]
"""What one crop's frame leaves to the next, in an order of the task's own."""


class Crop(Protocol):
    """What is looked at of one frame of a crop, whatever a task reads beside it."""

    @property
    def exposure(self) -> Tensor:
        """(1,) that images are shown with."""

    @property
    def reference(self) -> Tensor:
        """(1, 3, H, W) linear RGB, NaN where it is not known."""

    @property
    def reset(self) -> bool:
        """Whether it does not follow from the previous frame."""

    def on(self, device: torch.device) -> Self:
        """Return it with its tensors on `device`."""


CropT = TypeVar("CropT", bound=Crop)
CropsT = TypeVar("CropsT", bound=Crop, covariant=True)


class Crops(Protocol[CropsT]):
    """An endless walk through crops, frame by frame."""

    place: Place
    """From which it goes on when it is next iterated over."""

    def __iter__(self) -> Iterator[CropsT]:
        """Frames, from `place` on."""


class Stepped(NamedTuple):
    """What one step makes of a batch of n crops."""

    images: Tensor  # (n, 3, H, W) linear RGB
    states: list[State]  # of each crop
    weight: Tensor | float = 1.0  # (n, 1, H, W) of the image's error
    terms: Mapping[str, Tensor] = MappingProxyType({})  # of the loss beside the image's, weighted scalars


class Task(ABC, Generic[CropT]):
    """A method, and how it is trained.

    The trainer keeps the states from frame to frame, cuts their gradients off between updates, and saves
    them, so that a task remembers nothing.

    Attributes:
        method: its parameters are trained, in training mode but for the last updates.
        losses: weights of the image's terms, with those of the task's own.
    """

    method: Method
    losses: ImageWeights

    @property
    @abstractmethod
    def config(self) -> dict[str, Any]:
        """Settings that the method is made anew from, plain data."""

    @property
    def ratios(self) -> tuple[float, float]:
        """Of the sequences that it is validated on, least and largest."""
        return self.method.ratios

    @property
    def bar(self) -> Method:
        """The method that it is to beat."""
        return Taau()

    def data(self, dataset: Dataset) -> Dataset:
        """Return a set as the method is trained and validated on it.

        Raises:
            ArgumentError: it lacks what the method reads.
        """
        return dataset

    def walk(self, method: Method, display: Size) -> SequenceRunner:
        """Return how `method`, of this task, goes through whole sequences to be validated."""
        return SequenceRunner(method, display)

    @abstractmethod
    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Crops[CropT]:
        """Crops of sets that went through `data`, `size` pixels wide and high."""

    @abstractmethod
    def first_state(self, sample: CropT) -> State:
        """No history, for the first frame of a crop."""

    @abstractmethod
    def step(self, samples: list[CropT], states: list[State]) -> Stepped:
        """Step each crop once, the parts that learn for all of them together."""
