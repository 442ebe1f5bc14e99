"""How `extrapolate` is trained: on frames of both kinds in turn (Wu et al. 2023, section 4.4.2).

What a frame that is hidden shows is drawn, without gradients, as an engine would have it drawn: from the last
shaded frame of the crop, whose tensors are a part of the crop's state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods import LEARNED, METHODS
from supersampler_model.methods.base import Method, Size
from supersampler_model.methods.extrapolation.guided_warp import GuidedWarp
from supersampler_model.methods.extrapolation.joint import Extrapolate, packed_base_color
from supersampler_model.methods.weights_file import load_trained, shipped_weights
from supersampler_model.ops.sampling import sum_of
from supersampler_model.training.class_loss import ClassifierWeights
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.crops import Sample, Stream
from supersampler_model.training.task import State, Stepped
from supersampler_model.training.unshaded_crops import UnshadedStream, draw_render_region, unshaded_set
from supersampler_model.training.walk import AlternatingRunner, SequenceRunner

EXTRAPOLATED = 3
"""Crops of which frames are hidden, to one of a set's own frames, which may be of other ratios."""


@dataclass(frozen=True)
class ExtrapolateWeights(ClassifierWeights):
    """Weights of the terms; see `ClassifierWeights`.

    Attributes:
        ghost_drawn: as `ghost`, in frames that are drawn (equation 11).
        features: of how far apart what both encoders find in one frame is (equation 13).
    """

    ghost_extrapolated: float = 1.0
    features: float = 0.1


class Crop(NamedTuple):
    """One frame of a crop, of either kind."""

    sample: Sample  # its colour is drawn where it is hidden
    hidden: bool
    twin: Sample | None  # a shaded frame, drawn; None where there is nothing to draw it from
    left: State  # what the next is drawn from


class ExtrapolateTask(ClassifierTask):
    """Images and classes of frames of both kinds, and that both encoders find the same in one frame.

    States are in the order of `Classifier.history`, then what frames are drawn from, if anything.

    Args:
        method: to be trained.
        losses: weights of the terms.
        drawing: name of the method that draws hidden frames; of a learned one the weights ship.
    """

    method: Extrapolate
    losses: ExtrapolateWeights

    def __init__(
        self, method: Extrapolate, losses: ExtrapolateWeights | None = None, drawing: str = GuidedWarp.name
    ) -> None:
        super().__init__(method, losses or ExtrapolateWeights())
        self._drawing = _shipped(drawing)

    def data(self, dataset: Dataset) -> Dataset:
        """See `unshaded_set`."""
        return unshaded_set(dataset, self.method.ratios)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Crops anywhere. Those of the sets' own frames, without G-buffers of render size, are all shaded."""
        own = [dataset.own for dataset in datasets if dataset.own is not None]
        every, ratios = [*(EXTRAPOLATED * list(datasets)), *own], self.method.ratios
        return UnshadedStream(every, ratios=ratios, size=size, seed=seed, draw=draw_render_region)

    def walk(self, method: Method, display: Size) -> SequenceRunner:
        """Every second frame is hidden, and drawn."""
        return AlternatingRunner(method, display, self._drawing.to("cpu"))

    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """Step every crop, as `ClassifierTask` does; what is drawn takes no gradients."""
        count, net = len(self.method.history), self.method.net
        crops = [self._crop(s, state[count:]) for s, state in zip(samples, states, strict=True)]
        shown, pasts = [crop.sample for crop in crops], [state[:count] for state in states]
        gathered = [self.gather(sample, past) for sample, past in zip(shown, pasts, strict=True)]
        twins = [(i, crop.twin) for i, crop in enumerate(crops) if crop.twin is not None]
        with torch.no_grad():
            beside = [self.method.network_inputs(self.gather(twin, pasts[i])) for i, twin in twins]
        seen = [*map(self.method.network_inputs, gathered), *beside]
        surfaces = [_surface(c.sample) if c.hidden else None for c in crops] + [_surface(t) for _, t in twins]
        with torch.autocast(samples[0].color.device.type, torch.bfloat16, enabled=self.method.training):
            features = self._features(seen, surfaces)
            logits, blend = net.decode(
                torch.cat([packed for packed, _ in seen[: len(crops)]]), torch.cat(features[: len(crops)])
            )
        ghosts = [self.losses.ghost_extrapolated if crop.hidden else self.losses.ghost for crop in crops]
        weight = torch.tensor(ghosts, device=logits.device)[:, None, None, None]
        stepped = self.stepped(shown, gathered, logits.float(), blend.float(), weight)
        pairs = [(features[i], features[len(crops) + j]) for j, (i, _) in enumerate(twins)]
        terms = {**stepped.terms, "features": self.losses.features * _apart(pairs, logits)}
        after = [[*state, *crop.left] for state, crop in zip(stepped.states, crops, strict=True)]
        return stepped._replace(states=after, terms=terms)

    @torch.no_grad()
    def _crop(self, sample: Sample, past: State) -> Crop:
        """Draw a frame, and leave what the next one is drawn from."""
        if not sample.gbuffer:
            return Crop(sample, hidden=False, twin=None, left=[])
        drawing = self._drawing.to(sample.color.device)
        given = {**sample.gbuffer, "jitter": sample.view.jitter}
        given |= {name: getattr(sample, name) for name in ("color", "depth", "motion", "exposure")}
        shaded = drawing.after_shaded(given, past or None)
        if not past:
            return Crop(sample, hidden=False, twin=None, left=shaded)
        image, left, _ = drawing.step(*(given[name] for name in drawing.inputs()), *past)
        drawn = sample._replace(color=image)
        if sample.hidden:
            return Crop(drawn, hidden=True, twin=None, left=left)
        return Crop(sample, hidden=False, twin=drawn, left=shaded)

    def _features(
        self, seen: Sequence[tuple[Tensor, Tensor]], surfaces: Sequence[Tensor | None]
    ) -> list[Tensor]:
        """What the encoders find in each crop, those of a kind together; drawn ones have a surface."""
        found = dict[int, Tensor]()
        for drawn in (False, True):
            of = [i for i, surface in enumerate(surfaces) if (surface is not None) is drawn]
            if of:
                packed, carried = (torch.cat(parts) for parts in zip(*(seen[i] for i in of), strict=True))
                surface = torch.cat([s for s in surfaces if s is not None]) if drawn else None
                features = self.method.net.encode(packed, carried, surface)
                found |= zip(of, torch.split(features, 1), strict=True)
        return [found[i] for i in range(len(seen))]


def _surface(sample: Sample) -> Tensor:
    return packed_base_color(sample.gbuffer["gbuffer_base_color"], sample.view)


def _apart(pairs: Sequence[tuple[Tensor, Tensor]], like: Tensor) -> Tensor:
    """Mean absolute difference; 0 of no pairs."""
    if not pairs:
        return like.new_zeros(())
    return sum_of([(one.float() - other.float()).abs().mean() for one, other in pairs]) / len(pairs)


def _shipped(name: str) -> Method:
    """Return a method that draws, with the weights that ship of it.

    Raises:
        ArgumentError: it is none, or its weights are missing.
    """
    known = {**METHODS, **LEARNED}
    if name not in known or not known[name].extrapolates():
        want = f"one of {', '.join(n for n, method in known.items() if method.extrapolates())}"
        raise ArgumentError("drawing", got=name, want=want)
    if name in LEARNED:
        return LEARNED[name].of(load_trained(shipped_weights(name)))
    return METHODS[name]().eval()
