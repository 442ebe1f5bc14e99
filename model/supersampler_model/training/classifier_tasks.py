"""Training of the classifiers: crops of equal shapes are gathered as a batch, and all are inferred as one.

`extrapolate` is trained on alternating shaded and unshaded frames (Wu et al. 2023, section 4.4.2). The colour
of an unshaded frame is extrapolated as in an engine, without gradients, from the last shaded frame of the
crop, whose tensors are part of the crop's state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.methods.spec import large_size
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.data.labels import Ghost
from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_inputs import Gathered, History
from supersampler_model.methods.classifier_network import unpack
from supersampler_model.methods.extrapolate import Extrapolate, packed_base_color
from supersampler_model.methods.gbuffer_fast import GuidedClassifier, GuidedFrame
from supersampler_model.methods.guided_warp import GuidedWarp
from supersampler_model.training.crops import CropFrame, GBufferSizes, Stream, UnshadedStream
from supersampler_model.training.datasets import UNKNOWN, unshaded_set
from supersampler_model.training.losses import ClassifierWeights, class_loss
from supersampler_model.training.task import State, Stepped, Task, fast_convolutions, in_batches
from supersampler_model.training.validation import AlternatingRunner, SequenceRunner

EXTRAPOLATED = 3  # crops with unshaded frames per crop of the set's own frames, at other ratios


class ClassifierTask(Task):
    """Image and classification losses; states are in the order of `Classifier.history`, without a mean."""

    method: Classifier
    losses = ClassifierWeights()
    gbuffers: ClassVar[GBufferSizes] = "none"

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops at any position and ratio."""
        return Stream(datasets, ratios=self.method.ratios, size=size, seed=seed, gbuffers=self.gbuffers)

    def first_state(self, crop: CropFrame) -> State:
        """Return zeros, with the jitter of the crop's view."""
        empty = self.method.first_history(crop.view.display, ops.size_of(crop.color))
        color, state, classes, depth, _, exposure = (t.to(crop.color.device) for t in empty[:6])
        return [color, state, classes, depth, crop.view.jitter, exposure]

    def step(self, crops: list[CropFrame], states: list[State]) -> Stepped:
        """Step all crops; from frame to frame gradients flow only through the history colour."""
        method = self.method
        gathered, inputs = self.gather_all(crops, states)
        packed, half_inputs = map(torch.cat, zip(*inputs, strict=True))
        with fast_convolutions(packed.device, training=method.training):
            logits, blend = method.net(packed, half_inputs)
        return self.stepped(crops, gathered, logits.float(), blend.float(), self.losses.ghost)

    def stepped(
        self,
        crops: list[CropFrame],
        gathered: list[Gathered],
        logits: Tensor,
        blend: Tensor,
        ghost_weight: Tensor | float,
    ) -> Stepped:
        """Finish all crops from the network's outputs.

        Args:
            crops: this frame of each.
            gathered: results of the gather stage.
            logits: (n, 6, H / 2, W / 2).
            blend: (n, 4 m, H / 2, W / 2) packed blend parameters.
            ghost_weight: (n, 1, 1, 1) or a number: extra weight of the error without valid history.
        """
        method, images, after = self.method, [], []
        # in one split, because the gradient of each slice would be as large as the batch
        parts = (t.split_with_sizes([1] * len(crops)) for t in (logits, blend))
        finished = in_batches(
            lambda g, of_classes, of_blend: method.finish(g, of_classes, unpack(of_blend)),
            list(zip(gathered, *parts, strict=True)),
        )
        for g, crop, done in zip(gathered, crops, finished, strict=True):
            images.append(done.image)
            state, classes = done.state.detach(), done.classes.detach()
            after.append([done.image, state, classes, g.surfaces, crop.view.jitter, g.followed])
        ghost, alias = _ghost(crops, gathered), torch.cat([crop.alias for crop in crops])
        logits = ops.cut_to(logits, ops.half_of(gathered[0].display))
        samples = torch.cat([ops.cut_to(g.warped.samples, g.display) for g in gathered])[:, 0]
        invalid = (ghost == Ghost.VISIBILITY) | (ghost == Ghost.SHADING) | (samples <= 0.0)
        return Stepped(
            images=torch.cat(images),
            states=after,
            weight=1.0 + ghost_weight * invalid.float()[:, None],
            terms={"classes": class_loss(logits, ghost, alias, self.losses)},
        )

    def gather_all(
        self, crops: Sequence[CropFrame], states: Sequence[State]
    ) -> tuple[list[Gathered], list[tuple[Tensor, Tensor]]]:
        """Run the gather stage on all crops; return the results and the inputs of the network."""

        def gather(crop: CropFrame, state: State) -> tuple[Gathered, tuple[Tensor, Tensor]]:
            gathered = self.gather(crop, state)
            gathered = gathered._replace(reactive=crop.exposure.new_zeros(()))  # on the crop's device
            return gathered, self.method.network_inputs(gathered)

        inputs = [crop.without_truth() for crop in crops]
        results = in_batches(gather, list(zip(inputs, states, strict=True)))
        return [gathered for gathered, _ in results], [of_network for _, of_network in results]

    def gather(self, crop: CropFrame, state: State) -> Gathered:
        """Run the gather stage on one crop."""
        history, before = _history(crop, state)
        return self.method.gather(
            crop.color, crop.depth, crop.motion, crop.exposure, history, crop.view, before
        )


def _history(crop: CropFrame, state: State) -> tuple[History, ops.View]:
    """Return the history in a state, and the view of the previous frame; the region of a crop never moves."""
    color, counted, classes, depth, jitter, exposure = state[:6]
    return History(color, counted, classes, depth, exposure), crop.view._replace(jitter=jitter)


def _ghost(crops: list[CropFrame], gathered: list[Gathered]) -> Tensor:
    """Return ghosting classes, (n, H, W); pixels reprojected outside the crop are disoccluded."""
    ghost = torch.cat([crop.ghost for crop in crops])
    on_screen = torch.cat([ops.cut_to(g.reprojection.on_screen, g.display) for g in gathered])[:, 0]
    return torch.where((on_screen < 1.0) & (ghost < UNKNOWN), Ghost.VISIBILITY, ghost)


class LargeTask(ClassifierTask):
    """Task of `classifier-large`: states are 1.4 times as large as the crops and the images of the loss."""

    def step(self, crops: list[CropFrame], states: list[State]) -> Stepped:
        """Step enlarged crops, and downsample the images."""
        done, display = super().step([_enlarged(crop) for crop in crops], states), crops[0].view.display
        pairs = zip(done.images.split_with_sizes([1] * len(crops)), done.states, strict=True)
        images = [ops.downsample(image, display, state[-1].abs()) for image, state in pairs]
        weight = done.weight if isinstance(done.weight, float) else ops.resize_nearest(done.weight, display)
        return done._replace(images=torch.cat(images), weight=weight)


def _enlarged(crop: CropFrame) -> CropFrame:
    """Return the crop with the view and classes of the larger image."""
    display = ops.Size(*large_size(crop.view.display))
    ghost, alias = (ops.resize_nearest(classes[None], display)[0] for classes in (crop.ghost, crop.alias))
    return crop._replace(view=crop.view._replace(display=display), ghost=ghost, alias=alias)


class GuidedTask(ClassifierTask):
    """`gbuffer-fast`, on crops of any ratio with G-buffers of both sizes. The last state is reflectance."""

    method: GuidedClassifier
    gbuffers = "both"

    def data(self, dataset: Dataset) -> Dataset:
        """Return an `unshaded_set`.

        Raises:
            ArgumentError: see `unshaded_set`; or the set has no G-buffers of display size.
        """
        if not dataset.description.gbuffers:
            want = "a set made by `supersampler render --gbuffers --also 1.5,2,3,4`"
            raise ArgumentError("data", got=f"{dataset.folder}, without G-buffers of display size", want=want)
        return unshaded_set(dataset, self.method.ratios)

    def first_state(self, crop: CropFrame) -> State:
        """Return zeros, with the jitter of the crop's view."""
        state = super().first_state(crop)
        return [*state, state[0].new_zeros(state[0].shape)]

    def gather(self, crop: CropFrame, state: State) -> Gathered:
        """Run the gather stage on one crop."""
        history, before = _history(crop, state)
        render, display = self.method.surfaces_of(crop.gbuffer, crop.depth)
        frame = GuidedFrame(crop.color, crop.motion, crop.exposure, render, display, crop.view)
        return self.method.gather_guided(frame, history, state[-1], before)

    def stepped(
        self,
        crops: list[CropFrame],
        gathered: list[Gathered],
        logits: Tensor,
        blend: Tensor,
        ghost_weight: Tensor | float,
    ) -> Stepped:
        """Finish all crops, and add the reflectance to their states."""
        done = super().stepped(crops, gathered, logits, blend, ghost_weight)
        displays = [self.method.surfaces_of(crop.gbuffer, crop.depth)[1] for crop in crops]
        kept = [self.method.reflectance_of(display) for display in displays]
        states = [[*state, reflectance] for state, reflectance in zip(done.states, kept, strict=True)]
        return done._replace(states=states)


@dataclass(frozen=True)
class ExtrapolateWeights(ClassifierWeights):
    """Weights of the loss terms; see `ClassifierWeights`."""

    ghost_extrapolated: float = 1.0  # `ghost` of extrapolated frames (equation 11)
    features: float = 0.1  # of the difference between both encoders' features of one frame (equation 13)


class AlternatingCrop(NamedTuple):
    """One shaded or unshaded frame of a crop."""

    frame: CropFrame  # with extrapolated colour if unshaded
    unshaded: bool
    twin: CropFrame | None  # the shaded frame with extrapolated colour; None without history
    next_history: State  # of the extrapolator


class ExtrapolateTask(ClassifierTask):
    """Image, classification and feature losses on shaded and unshaded frames.

    States are in the order of `Classifier.history`, followed by the history of `guided-warp`, if any, which
    extrapolates unshaded frames.
    """

    method: Extrapolate
    losses = ExtrapolateWeights()

    def __init__(self, method: Extrapolate) -> None:
        super().__init__(method)
        self._extrapolator = GuidedWarp().eval()

    def data(self, dataset: Dataset) -> Dataset:
        """Return an `unshaded_set`."""
        return unshaded_set(dataset, self.method.ratios)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops; the sets' own frames, without G-buffers of render size, are all shaded."""
        own = [dataset.own for dataset in datasets if dataset.own is not None]
        every, ratios = [*(EXTRAPOLATED * list(datasets)), *own], self.method.ratios
        return UnshadedStream(every, ratios=ratios, size=size, seed=seed, gbuffers="render")

    def runner(self, method: Method, display: ops.Size) -> SequenceRunner:
        """Return a runner that extrapolates every second frame."""
        return AlternatingRunner(method, display, self._extrapolator.to("cpu"))

    def step(self, crops: list[CropFrame], states: list[State]) -> Stepped:
        """Step all crops; extrapolation has no gradients."""
        count, net = len(self.method.history), self.method.net
        made = [self._extrapolated(crop, state[count:]) for crop, state in zip(crops, states, strict=True)]
        frames, histories = [one.frame for one in made], [state[:count] for state in states]
        gathered, method_inputs = self.gather_all(frames, histories)
        twins = [(i, one.twin) for i, one in enumerate(made) if one.twin is not None]
        with torch.no_grad():
            _, twin_inputs = self.gather_all([twin for _, twin in twins], [histories[i] for i, _ in twins])
        inputs = [*method_inputs, *twin_inputs]
        surfaces = [_surface(one.frame) if one.unshaded else None for one in made]
        surfaces += [_surface(twin) for _, twin in twins]
        with fast_convolutions(crops[0].color.device, training=self.method.training):
            features = self._features(inputs, surfaces)
            packed = torch.cat([packed for packed, _ in method_inputs])
            logits, blend = net.decode(packed, features[: len(made)])
        ghosts = [self.losses.ghost_extrapolated if one.unshaded else self.losses.ghost for one in made]
        weight = torch.tensor(ghosts, device=logits.device)[:, None, None, None]
        stepped = self.stepped(frames, gathered, logits.float(), blend.float(), weight)
        shaded, extrapolated = features[[i for i, _ in twins]], features[len(made) :]
        difference = (shaded.float() - extrapolated.float()).abs().sum() / max(shaded.numel(), 1)
        terms = {**stepped.terms, "features": self.losses.features * difference}
        after = [[*state, *one.next_history] for state, one in zip(stepped.states, made, strict=True)]
        return stepped._replace(states=after, terms=terms)

    @torch.no_grad()
    def _extrapolated(self, crop: CropFrame, history: State) -> AlternatingCrop:
        """Extrapolate a frame if necessary, and update the history of the extrapolator."""
        if not crop.gbuffer:
            return AlternatingCrop(crop, unshaded=False, twin=None, next_history=[])
        extrapolator = self._extrapolator.to(crop.color.device)
        given = {**crop.gbuffer, "jitter": crop.view.jitter, "pre_exposure": crop.exposure.new_ones(1)}
        given |= {name: getattr(crop, name) for name in ("color", "depth", "motion", "exposure")}
        shaded = extrapolator.after_shaded(given, history or None)
        if not history:
            return AlternatingCrop(crop, unshaded=False, twin=None, next_history=shaded)
        image, next_history, _ = extrapolator.step(*(given[name] for name in extrapolator.inputs()), *history)
        extrapolated = crop._replace(color=image)
        if crop.unshaded:
            return AlternatingCrop(extrapolated, unshaded=True, twin=None, next_history=next_history)
        return AlternatingCrop(crop, unshaded=False, twin=extrapolated, next_history=shaded)

    def _features(self, inputs: Sequence[tuple[Tensor, Tensor]], surfaces: Sequence[Tensor | None]) -> Tensor:
        """Return the features of all crops, in one batch per encoder; shaded crops have no surface."""
        packed, half_inputs = map(torch.cat, zip(*inputs, strict=True))
        shaded = [i for i, surface in enumerate(surfaces) if surface is None]
        extrapolated = [i for i, surface in enumerate(surfaces) if surface is not None]
        known = [surface for surface in surfaces if surface is not None]
        features = [
            self.method.net.encode(packed[crops], half_inputs[crops], surface)
            for crops, surface in ((shaded, None), (extrapolated, torch.cat(known) if known else None))
            if crops
        ]
        return torch.cat(features)[torch.tensor([*shaded, *extrapolated]).argsort()]


def _surface(crop: CropFrame) -> Tensor:
    return packed_base_color(crop.gbuffer["gbuffer_base_color"], crop.view)
