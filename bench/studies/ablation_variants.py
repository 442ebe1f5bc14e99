"""Variants of methods for `ablation.py`, each with one choice changed or without one part."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from typing import Any

from supersampler.methods.classifier.spec import INPUTS, ClassifierConfig, PaperConfig, SmallConfig
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler_model.methods.classifier import Classifier, SmallClassifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.gbuffer import FrameInputs, Gathered, History, SmallGBuffer4
from supersampler_model.methods.gbuffer_surfaces import Surfaces, neutral_surfaces
from supersampler_model.ops.images import size_of
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.gbuffer_task import GBufferTask, GBufferWeights
from supersampler_model.training.losses import ClassifierWeights
from supersampler_model.training.task import Task

Variants = Mapping[str, Callable[[], Task]]
"""Tasks by the variant's name; each of the others differs from the first in one thing."""

ALL_INPUTS = ClassifierConfig(inputs=INPUTS)
"""The configuration of the first variant; each other one changes one field, except those of another width."""


def _classifier(**fields: Any) -> Callable[[], Classifier]:
    return lambda: Classifier(replace(ALL_INPUTS, **fields))


def _without_inputs(*inputs: str) -> Callable[[], Classifier]:
    return _classifier(inputs=tuple(name for name in INPUTS if name not in inputs))


CLASSIFIERS: Mapping[str, Callable[[], Classifier]] = {
    "all inputs seen": _classifier(),
    "half the width (`classifier-small`)": lambda: SmallClassifier(
        SmallConfig(inputs=INPUTS, rectified=True, own_motion=True)
    ),
    "the paper's form (`classifier-paper`)": lambda: PaperClassifier(PaperConfig(inputs=INPUTS)),
    "history not clipped to the box": _classifier(rectified=False),
    "no history by the pixel's own motion": _classifier(own_motion=False),
    "differences of history and frame not seen": _without_inputs(
        "history_to_sample", "history_to_frame", "beyond_range"
    ),
    "means of differences around not seen": _classifier(neighbourhood_inputs=()),
    "contrasts not seen": _without_inputs("contrast", "history_contrast"),
    "range of the history not seen": _without_inputs("min_luma", "max_luma"),
    "range only grows": _classifier(contraction=0.0),
    "distance of samples not seen": _without_inputs("confidence"),
    "count not seen": _without_inputs("count"),
    "difference of depth and disocclusion not seen": _without_inputs("depth_difference", "surface"),
    "classes of the frame before not seen": _classifier(recurrent=False),
    "speed and blur not seen (the default)": Classifier,
    "each channel toned alone": _classifier(tone_space="channels"),
    "toned by logarithms": _classifier(tone_space="logarithm"),
    "count seen by its logarithm": _classifier(count_code="logarithm"),
}
"""Networks after Guo et al. 2024."""

CLASSES: Variants = {
    "all of it": lambda: ClassifierTask(SmallClassifier()),
    "without the loss of the classes": lambda: ClassifierTask(
        SmallClassifier(), ClassifierWeights(classes=0.0)
    ),
    "classes of the frame before not seen": lambda: ClassifierTask(
        SmallClassifier(SmallConfig(recurrent=False))
    ),
}
"""Contribution of the classes. Without their loss, their six outputs learn whatever helps the image."""

SURFACE_BUFFERS = ("base_color", "normal", "roughness", "metallic", "specular")


class WithoutBuffers(SmallGBuffer4):
    """A `gbuffer-small` at 4x that lacks G-buffers.

    Args:
        neutral: fields of `Surfaces` replaced by those of `neutral_surfaces`, at both sizes.
        nearest: fields whose display-size buffer is the nearest render sample's.
    """

    def __init__(self, neutral: Collection[str] = (), nearest: Collection[str] = ()) -> None:
        super().__init__()
        self.neutral, self.nearest = neutral, nearest

    def gather(self, frame: FrameInputs, history: History) -> Gathered:
        """See `GBuffer.gather`."""
        grid = frame.view.grid(size_of(frame.color))
        near = {name: grid.pick(getattr(frame.render, name)) for name in self.nearest}
        display = self._neutralized(frame.display._replace(**near))
        render = self._neutralized(frame.render)
        return super().gather(frame._replace(render=render, display=display), history)

    def _neutralized(self, surfaces: Surfaces) -> Surfaces:
        neutral = neutral_surfaces(surfaces.depth)
        return surfaces._replace(**{name: getattr(neutral, name) for name in self.neutral})


def _without(*buffers: str) -> Callable[[], Task]:
    return lambda: GBufferTask(WithoutBuffers(buffers))


def _gbuffer(**fields: Any) -> Callable[[], Task]:
    return lambda: GBufferTask(SmallGBuffer4(GBufferConfig(ratio=4, **{"network": SMALL_NETWORK, **fields})))


def _network(**fields: Any) -> Callable[[], Task]:
    return _gbuffer(network=replace(SMALL_NETWORK, **fields))


GBUFFERS: Variants = {
    "all of it": _gbuffer(),
    "without base colour": _without("base_color"),
    "without normals": _without("normal"),
    "without metallic": _without("metallic"),
    "without roughness": _without("roughness"),
    "without specular": _without("specular"),
    "without depth of display size": lambda: GBufferTask(WithoutBuffers(nearest=("depth",))),
    "depth alone": _without(*SURFACE_BUFFERS),
    "without G-buffers of display size": lambda: GBufferTask(WithoutBuffers(nearest=Surfaces._fields)),
    "without the gated encoder, unshuffled alone": _network(
        surfaces=SMALL_NETWORK.surfaces[-1:], gated=False
    ),
    "without the gated branch": _network(gated=False),
    "without the enhancer": _network(attention="none"),
    "attention one way": _network(attention="one"),
    "without the masks of the blender": _gbuffer(masked=False),
    "without the refiner": _network(refined=False),
    "without weights in the loss": lambda: GBufferTask(
        SmallGBuffer4(), GBufferWeights(reflective=0.0, reflective_structure=0.0)
    ),
    "history not blended, features alone": _gbuffer(blended=False),
}
"""Parts of Wang et al. 2025, tables VI and IX."""


def _task(make: Callable[[], Classifier]) -> Callable[[], Task]:
    return lambda: ClassifierTask(make())


VARIANTS: Mapping[str, Variants] = {
    "classifier": {name: _task(make) for name, make in CLASSIFIERS.items()},
    "classifier-small": CLASSES,
    "gbuffer-small-4x": GBUFFERS,
}
"""Variants by method."""
