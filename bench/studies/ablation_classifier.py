"""Variants of the classifier for `ablation.py`, each with one choice changed."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from supersampler.methods.classifier.spec import INPUTS, ClassifierConfig, PaperConfig, SmallConfig
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.classifier_paper.model import PaperClassifier
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.task import Task

ALL_SEEN = ClassifierConfig(inputs=INPUTS)
"""What each variant but those of other widths differs from in one thing; the default does, too."""


def without(*inputs: str) -> ClassifierConfig:
    """Return `ALL_SEEN` with a network that does not see these inputs."""
    return replace(ALL_SEEN, inputs=tuple(name for name in INPUTS if name not in inputs))


def changed(**fields: Any) -> Callable[[], Classifier]:
    """Return what makes `ALL_SEEN` with other values of these fields."""
    return lambda: Classifier(replace(ALL_SEEN, **fields))


METHODS: Mapping[str, Callable[[], Classifier]] = {
    "all inputs seen": changed(),
    "half the width (`classifier-small`)": lambda: SmallClassifier(
        SmallConfig(inputs=INPUTS, rectified=True, own_motion=True)
    ),
    "the paper's form (`classifier-paper`)": lambda: PaperClassifier(PaperConfig(inputs=INPUTS)),
    "history not clipped to the box": changed(rectified=False),
    "no history by the pixel's own motion": changed(own_motion=False),
    "differences of history and frame not seen": lambda: Classifier(
        without("history_to_sample", "history_to_frame", "beyond_range")
    ),
    "means of differences around not seen": changed(neighbourhood_inputs=()),
    "contrasts not seen": lambda: Classifier(without("contrast", "history_contrast")),
    "range of the history not seen": lambda: Classifier(without("min_luma", "max_luma")),
    "range only grows": changed(contraction=0.0),
    "distance of samples not seen": lambda: Classifier(without("confidence")),
    "count not seen": lambda: Classifier(without("count")),
    "difference of depth and disocclusion not seen": lambda: Classifier(
        without("depth_difference", "surface")
    ),
    "classes of the frame before not seen": changed(recurrent=False),
    "speed and blur not seen (the default)": Classifier,
    "each channel toned alone": changed(tone_space="channels"),
    "toned by logarithms": changed(tone_space="logarithm"),
    "count seen by its logarithm": changed(count_code="logarithm"),
}


def _task(make: Callable[[], Classifier]) -> Callable[[], Task[Any]]:
    return lambda: ClassifierTask(make())


VARIANTS: Mapping[str, Callable[[], Task[Any]]] = {name: _task(make) for name, make in METHODS.items()}
