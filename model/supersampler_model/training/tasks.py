"""`TASKS` maps names of methods to training tasks."""

from collections.abc import Callable, Mapping
from typing import Any

from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.classifier_large.model import LargeClassifier
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
from supersampler_model.methods.gbuffer_fast.model import GuidedClassifier
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.methods.weights_file import Trained
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.extrapolate_task import ExtrapolateTask
from supersampler_model.training.flow_task import FlowTask
from supersampler_model.training.gbuffer_task import GBufferTask
from supersampler_model.training.guided_task import GuidedTask
from supersampler_model.training.large_task import LargeTask
from supersampler_model.training.task import Task

Start = Callable[[Trained | None], Task[Any]]


def _start(task: Callable[[Any], Task[Any]], method: type[LearnedMethod]) -> Start:
    return lambda weights: task(method() if weights is None else method.of(weights))


def _from_classifier(
    task: Callable[[Any], Task[Any]],
    method: type[LargeClassifier] | type[GuidedClassifier] | type[Extrapolate],
) -> Start:
    """Start from weights of `classifier`, too."""

    def start(weights: Trained | None) -> Task[Any]:
        if weights is None or weights.method == method.name:
            return _start(task, method)(weights)
        return task(method.from_classifier(weights))

    return start


_CLASSIFIERS = (Classifier, SmallClassifier, PaperClassifier)
_GBUFFERS = (GBuffer, GBuffer4, SmallGBuffer, SmallGBuffer4, DepthGBuffer)
TASKS: Mapping[str, Start] = {
    **{method.name: _start(ClassifierTask, method) for method in _CLASSIFIERS},
    **{method.name: _start(GBufferTask, method) for method in _GBUFFERS},
    LargeClassifier.name: _from_classifier(LargeTask, LargeClassifier),
    Extrapolate.name: _from_classifier(ExtrapolateTask, Extrapolate),
    GuidedClassifier.name: _from_classifier(GuidedTask, GuidedClassifier),
    GuidedFlow.name: _start(FlowTask, GuidedFlow),
}
"""`TASKS[name](weights)` starts from these weights; None: untrained."""
