"""Training of `guided-flow` on unshaded frames, by the error to their shaded colour.

The census loss of light (Wu et al. 2023, equations 8 and 9) is not used: with it the network fitted the noise
of light and inferred no motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method
from supersampler_model.methods.extrapolation.guided_flow import GuidedFlow
from supersampler_model.methods.extrapolation.guided_warp import GuidedWarp
from supersampler_model.ops.size import Size
from supersampler_model.training.flow_crops import LightCache, LightSample, LightStream
from supersampler_model.training.gbuffer_crops import gbuffer_set
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.sequence_runner import ExtrapolationRunner, SequenceRunner
from supersampler_model.training.task import State, Stepped, Task

RATIO = 2  # at which data sets are rendered a second time, with G-buffers of render size


@dataclass(frozen=True)
class FlowWeights(ImageWeights):
    """Weights of the loss terms; see `ImageWeights`.

    Attributes:
        rms: larger than the default: unknown light should be predicted as its mean.
        change: 0, as crops are single frames.
        changed: extra weight of the error where the lighting changed.
    """

    rms: float = 3.0
    change: float = 0.0
    changed: float = 1.0


class FlowTask(Task[LightSample]):
    """Single unshaded frames without state."""

    def __init__(self, method: GuidedFlow, losses: FlowWeights | None = None) -> None:
        self.method: GuidedFlow = method
        self.losses: FlowWeights = losses or FlowWeights()
        self._lights = LightCache(method)

    @property
    def ratios(self) -> tuple[float, float]:
        """Ratio of the frames with G-buffers of render size."""
        return float(RATIO), float(RATIO)

    @property
    def baseline(self) -> Method:
        """`guided-warp`, which the untrained method equals."""
        return GuidedWarp()

    def data(self, dataset: Dataset) -> Dataset:
        """See `gbuffer_set`."""
        return gbuffer_set(dataset, RATIO)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> LightStream:
        """Stream crops of light; all streams share one cache.

        Raises:
            ArgumentError: see `LightStream`; or the coarsest level of the network would be a single pixel,
                which batch normalisation cannot normalise.
        """
        least = 2 ** (len(self.method.config.network.levels) + 1)
        if size <= least:
            raise ArgumentError("size", got=size, want=f"more than {least}")
        return LightStream(datasets, self._lights, ratio=RATIO, size=size, seed=seed)

    def runner(self, method: Method, display: Size) -> SequenceRunner:
        """Every second frame is unshaded; only those are scored."""
        return ExtrapolationRunner(method, display)

    def first_state(self, sample: LightSample) -> State:  # noqa: ARG002  # part of the interface
        """Return no state."""
        return []

    def step(self, samples: list[LightSample], states: list[State]) -> Stepped:
        """Step all crops as one batch."""
        together = (torch.cat(parts) for parts in zip(*(sample[:-1] for sample in samples), strict=True))
        later, earlier, light, guides, reflectance, _, changed, _ = together
        with torch.autocast(later.device.type, torch.bfloat16, enabled=self.method.training):
            (inferred,) = self.method.net(later, earlier)
        light = self.method.refined(light, guides, inferred.float())
        return Stepped(light * reflectance, states, weight=1.0 + self.losses.changed * changed)
