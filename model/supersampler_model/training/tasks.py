"""`TASKS` maps names of methods to training tasks."""

from collections.abc import Callable, Mapping
from typing import Any

from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.classifier_paper.model import PaperClassifier
from supersampler_model.methods.extrapolation.guided_flow import GuidedFlow
from supersampler_model.methods.extrapolation.joint import Extrapolate
from supersampler_model.methods.gbuffer.model import (
    DepthGBuffer,
    GBuffer,
    GBuffer4,
    SmallGBuffer,
    SmallGBuffer4,
)
from supersampler_model.methods.weights_file import Trained
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.extrapolate_task import ExtrapolateTask
from supersampler_model.training.flow_task import FlowTask
from supersampler_model.training.gbuffer_task import GBufferTask
from supersampler_model.training.task import Task


def _classifier(method: type[Classifier]) -> Callable[[Trained | None], Task[Any]]:
    return lambda weights: ClassifierTask(method() if weights is None else method.of(weights))


def _gbuffer(method: type[GBuffer]) -> Callable[[Trained | None], Task[Any]]:
    return lambda weights: GBufferTask(method() if weights is None else method.of(weights))


def _extrapolate(weights: Trained | None) -> Task[Any]:
    if weights is None:
        return ExtrapolateTask(Extrapolate())
    own = weights.method == Extrapolate.name
    return ExtrapolateTask(Extrapolate.of(weights) if own else Extrapolate.from_classifier(weights))


def _flow(weights: Trained | None) -> Task[Any]:
    return FlowTask(GuidedFlow() if weights is None else GuidedFlow.of(weights))


TASKS: Mapping[str, Callable[[Trained | None], Task[Any]]] = {
    **{method.name: _classifier(method) for method in (Classifier, SmallClassifier, PaperClassifier)},
    **{
        method.name: _gbuffer(method)
        for method in (GBuffer, GBuffer4, SmallGBuffer, SmallGBuffer4, DepthGBuffer)
    },
    Extrapolate.name: _extrapolate,
    GuidedFlow.name: _flow,
}
"""`TASKS[name](weights)` starts from these weights; None: untrained."""
