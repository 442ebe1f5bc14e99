"""How `guided-flow` is trained: on hidden frames, by how far what is drawn is from what would be shaded.

Not by the census of light (Wu et al. 2023, equations 8 and 9), which holds it to its noise, where it has any,
and kept the network from moving anything.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method, Size
from supersampler_model.methods.extrapolation.guided_flow import GuidedFlow
from supersampler_model.methods.extrapolation.guided_warp import GuidedWarp
from supersampler_model.training.flow_crops import Lights, LightSample, LightStream
from supersampler_model.training.gbuffer_crops import gbuffer_set
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.task import State, Stepped, Task
from supersampler_model.training.walk import ExtrapolationRunner, SequenceRunner

RATIO = 2  # at which sets are drawn again, with G-buffers of render size


@dataclass(frozen=True)
class FlowWeights(ImageWeights):
    """Weights of the terms; see `ImageWeights`.

    Attributes:
        rms: more than of images: light that is guessed calls for the mean of what may be there.
        change: none, as crops do not follow from one another.
        changed: of errors where light has changed, beside that everywhere.
    """

    rms: float = 3.0
    change: float = 0.0
    changed: float = 1.0


class FlowTask(Task[LightSample]):
    """Hidden frames alone, which leave nothing to one another."""

    def __init__(self, method: GuidedFlow, losses: FlowWeights | None = None) -> None:
        self.method: GuidedFlow = method
        self.losses: FlowWeights = losses or FlowWeights()
        self._lights = Lights(method)

    @property
    def config(self) -> dict[str, Any]:
        """Of the method."""
        return asdict(self.method.config)

    @property
    def ratios(self) -> tuple[float, float]:
        """Of frames that were drawn with what the method reads."""
        return float(RATIO), float(RATIO)

    @property
    def bar(self) -> Method:
        """What it draws untrained."""
        return GuidedWarp()

    def data(self, dataset: Dataset) -> Dataset:
        """See `gbuffer_set`."""
        return gbuffer_set(dataset, RATIO)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> LightStream:
        """Crops of light; all streams share what was found of it.

        Raises:
            ArgumentError: see `LightStream`; or the network's coarsest level has one pixel of a crop, which
                batch normalisation can tell nothing of.
        """
        least = 2 ** (len(self.method.config.network.levels) + 1)
        if size <= least:
            raise ArgumentError("size", got=size, want=f"more than {least}")
        return LightStream(datasets, self._lights, ratio=RATIO, size=size, seed=seed)

    def walk(self, method: Method, display: Size) -> SequenceRunner:
        """Every second frame is hidden; images are of those alone."""
        return ExtrapolationRunner(method, display)

    def first_state(self, sample: LightSample) -> State:  # noqa: ARG002  # as all have none
        """Nothing."""
        return []

    def step(self, samples: list[LightSample], states: list[State]) -> Stepped:
        """Draw all crops together."""
        together = (torch.cat(parts) for parts in zip(*(sample[:-1] for sample in samples), strict=True))
        later, earlier, light, guides, reflectance, _, changed, _ = together
        with torch.autocast(later.device.type, torch.bfloat16, enabled=self.method.training):
            (said,) = self.method.net(later, earlier)
        light = self.method.refined(light, guides, said.float())
        return Stepped(light * reflectance, states, weight=1.0 + self.losses.changed * changed)
