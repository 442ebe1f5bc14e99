"""What training asks of a method that learns: one step of a batch of crops, and where these come from."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from torch import Tensor

from supersampler_model.data.dataset import Dataset
from supersampler_model.method import Method, Size
from supersampler_model.methods.taau import Taau
from supersampler_model.train.losses import PictureWeights
from supersampler_model.train.walk import Walk
from supersampler_model.train.windows import Sample, Stream

State = list[Tensor]
"""What one crop's frame leaves to the next, in an order of the task's own."""


class Stepped(NamedTuple):
    """What one step makes of a batch of n crops."""

    images: Tensor  # (n, 3, H, W) linear RGB
    states: list[State]  # of each crop
    weight: Tensor | float = 1.0  # (n, 1, H, W) of the picture's error
    terms: Mapping[str, Tensor] = MappingProxyType({})  # of the loss beside the picture's, weighted scalars


class Task(ABC):
    """A method, and how it is trained.

    The trainer keeps the states from frame to frame, cuts their gradients off between updates, and saves
    them, so that a task remembers nothing.

    Attributes:
        method: its parameters are trained, in training mode but for the last updates.
        losses: weights of the picture's terms, with those of the task's own.
    """

    method: Method
    losses: PictureWeights

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

    def walk(self, method: Method, display: Size) -> Walk:
        """Return how `method`, of this task, goes through whole sequences to be validated."""
        return Walk(method, display)

    @abstractmethod
    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Crops of sets that went through `data`, as `Stream` describes them."""

    @abstractmethod
    def first_state(self, sample: Sample) -> State:
        """No past, for the first frame of a crop."""

    @abstractmethod
    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """Step each crop once, the parts that learn for all of them together."""
