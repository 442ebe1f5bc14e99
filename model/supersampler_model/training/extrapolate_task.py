"""Training of `extrapolate`, on shaded and unshaded frames in turn (Wu et al. 2023, section 4.4.2).

The colour of an unshaded frame is extrapolated as in an engine, without gradients, from the last shaded frame
of the crop. The tensors of that frame are part of the crop's state.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.methods.registry import methods
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods import load_method
from supersampler_model.methods.base import Method
from supersampler_model.methods.extrapolation.guided_warp import GuidedWarp
from supersampler_model.methods.extrapolation.joint import SURFACE, Extrapolate, packed_base_color
from supersampler_model.ops.size import Size
from supersampler_model.training.class_loss import ClassifierWeights
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.crops import Sample, Stream
from supersampler_model.training.gbuffer_crops import UnshadedStream, unshaded_set
from supersampler_model.training.processes import mean_of_processes, process_count, uncounted
from supersampler_model.training.sequence_runner import AlternatingRunner, SequenceRunner
from supersampler_model.training.task import State, Stepped

EXTRAPOLATED = 3
"""Crops with unshaded frames per crop of the data set's own frames, which may have other ratios."""


@dataclass(frozen=True)
class ExtrapolateWeights(ClassifierWeights):
    """Weights of the loss terms; see `ClassifierWeights`.

    Attributes:
        ghost_extrapolated: as `ghost`, in extrapolated frames (equation 11).
        features: weight of the difference between both encoders' features of one frame (equation 13).
    """

    ghost_extrapolated: float = 1.0
    features: float = 0.1


class Crop(NamedTuple):
    """One shaded or unshaded frame of a crop."""

    sample: Sample  # with extrapolated colour if unshaded
    unshaded: bool
    twin: Sample | None  # of a shaded frame: the same with extrapolated colour; None without history
    next_history: State  # of the extrapolator


class ExtrapolateTask(ClassifierTask):
    """Image, classification and feature losses on shaded and unshaded frames.

    States are in the order of `Classifier.history`, then the history of the extrapolator, if any.

    Args:
        method: to be trained.
        losses: weights of the loss terms.
        extrapolator: name of the method that extrapolates unshaded frames, with its released weights.
    """

    method: Extrapolate
    losses: ExtrapolateWeights

    def __init__(
        self,
        method: Extrapolate,
        losses: ExtrapolateWeights | None = None,
        extrapolator: str = GuidedWarp.name,
    ) -> None:
        super().__init__(method, losses or ExtrapolateWeights())
        self._extrapolator = _shipped(extrapolator)

    def data(self, dataset: Dataset) -> Dataset:
        """See `unshaded_set`."""
        return unshaded_set(dataset, self.method.ratios)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops; those of the sets' own frames, without G-buffers of render size, are all shaded."""
        own = [dataset.own for dataset in datasets if dataset.own is not None]
        every, ratios = [*(EXTRAPOLATED * list(datasets)), *own], self.method.ratios
        return UnshadedStream(every, ratios=ratios, size=size, seed=seed)

    def runner(self, method: Method, display: Size) -> SequenceRunner:
        """Every second frame is unshaded and extrapolated."""
        return AlternatingRunner(method, display, self._extrapolator.to("cpu"))

    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """Step all crops, as `ClassifierTask` does; extrapolation takes no gradients."""
        count, net = len(self.method.history), self.method.net
        crops = [self._crop(s, state[count:]) for s, state in zip(samples, states, strict=True)]
        frames, histories = [crop.sample for crop in crops], [state[:count] for state in states]
        gathered, frame_inputs = self.gather_all(frames, histories)
        twins = [(i, crop.twin) for i, crop in enumerate(crops) if crop.twin is not None]
        with torch.no_grad():
            _, twin_inputs = self.gather_all([twin for _, twin in twins], [histories[i] for i, _ in twins])
        inputs = [*frame_inputs, *twin_inputs]
        surfaces = [_surface(crop.sample) if crop.unshaded else None for crop in crops]
        surfaces += [_surface(twin) for _, twin in twins]
        with torch.autocast(samples[0].color.device.type, torch.bfloat16, enabled=self.method.training):
            features = self._features(inputs, surfaces)
            logits, blend = net.decode(
                torch.cat([packed for packed, _ in inputs[: len(crops)]]), features[: len(crops)]
            )
        ghosts = [self.losses.ghost_extrapolated if crop.unshaded else self.losses.ghost for crop in crops]
        weight = torch.tensor(ghosts, device=logits.device)[:, None, None, None]
        stepped = self.stepped(frames, gathered, logits.float(), blend.float(), weight)
        difference = _mean_difference(features[[i for i, _ in twins]], features[len(crops) :])
        terms = {**stepped.terms, "features": self.losses.features * difference}
        after = [[*state, *crop.next_history] for state, crop in zip(stepped.states, crops, strict=True)]
        return stepped._replace(states=after, terms=terms)

    @torch.no_grad()
    def _crop(self, sample: Sample, history: State) -> Crop:
        """Extrapolate a frame where needed, and update the history of the extrapolator."""
        if not sample.gbuffer:
            return Crop(sample, unshaded=False, twin=None, next_history=[])
        extrapolator = self._extrapolator.to(sample.color.device)
        given = {**sample.gbuffer, "jitter": sample.view.jitter}
        given["pre_exposure"] = sample.exposure.new_ones(1)
        given |= {name: getattr(sample, name) for name in ("color", "depth", "motion", "exposure")}
        shaded = extrapolator.after_shaded(given, history or None)
        if not history:
            return Crop(sample, unshaded=False, twin=None, next_history=shaded)
        image, next_history, _ = extrapolator.step(*(given[name] for name in extrapolator.inputs()), *history)
        extrapolated = sample._replace(color=image)
        if sample.unshaded:
            return Crop(extrapolated, unshaded=True, twin=None, next_history=next_history)
        return Crop(sample, unshaded=False, twin=extrapolated, next_history=shaded)

    def _features(self, inputs: Sequence[tuple[Tensor, Tensor]], surfaces: Sequence[Tensor | None]) -> Tensor:
        """Return the features of all crops, in one batch per encoder; extrapolated crops have a surface.

        Processes normalise each batch together: one without crops for it runs a crop that does not count.
        """
        packed, half_inputs = map(torch.cat, zip(*inputs, strict=True))
        shaded = [i for i, surface in enumerate(surfaces) if surface is None]
        extrapolated = [i for i, surface in enumerate(surfaces) if surface is not None]
        known = [surface for surface in surfaces if surface is not None]
        surface = torch.cat(known or [packed.new_zeros(1, 4 * SURFACE, *packed.shape[2:])])
        features, order = list[Tensor](), list[int]()
        for batch, of_batch in ((shaded, None), (extrapolated, surface)):
            if batch or process_count() > 1:
                crops = batch or [0]
                with contextlib.nullcontext() if batch else uncounted():
                    features.append(self.method.net.encode(packed[crops], half_inputs[crops], of_batch))
                order += batch or [len(inputs)]
        return torch.cat(features)[torch.tensor(order).argsort()[: len(inputs)]]


def _surface(sample: Sample) -> Tensor:
    return packed_base_color(sample.gbuffer["gbuffer_base_color"], sample.view)


def _mean_difference(one: Tensor, other: Tensor) -> Tensor:
    """Return the mean absolute difference of pairs; 0 without pairs."""
    difference = (one.float() - other.float()).abs()
    return difference.sum() / mean_of_processes(difference.new_tensor(difference.numel())).clamp(min=1.0)


def _shipped(name: str) -> Method:
    """Return an extrapolating method with its released weights.

    Raises:
        ArgumentError: the method does not extrapolate, or its weights are missing.
    """
    known = [name for name, spec in methods().items() if spec.extrapolates]
    if name not in known:
        raise ArgumentError("extrapolator", got=name, want=f"one of {', '.join(known)}")
    return load_method(name)
