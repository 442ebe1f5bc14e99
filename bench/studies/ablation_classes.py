"""Variants of `classifier-small` for `ablation.py`: what its classes give."""

from collections.abc import Callable, Mapping
from typing import Any

from supersampler.methods.classifier.spec import SmallConfig
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.training.class_loss import ClassifierWeights
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.task import Task

VARIANTS: Mapping[str, Callable[[], Task[Any]]] = {
    "all of it": lambda: ClassifierTask(SmallClassifier()),
    "without the loss of the classes": lambda: ClassifierTask(
        SmallClassifier(), ClassifierWeights(classes=0.0)
    ),
    "classes of the frame before not seen": lambda: ClassifierTask(
        SmallClassifier(SmallConfig(recurrent=False))
    ),
}
"""Variants by name. Without their loss, the six outputs for the classes learn whatever helps the image."""
