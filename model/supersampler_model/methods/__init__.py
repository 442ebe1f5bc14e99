"""One file per method; `METHODS` finds them by name."""

from collections.abc import Mapping

from supersampler_model.method import Method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.classifier_small import SmallClassifier
from supersampler_model.methods.extrapolate import Extrapolate
from supersampler_model.methods.gbuffer import GBuffer, GBuffer4
from supersampler_model.methods.gbuffer_depth import DepthGBuffer
from supersampler_model.methods.gbuffer_small import SmallGBuffer, SmallGBuffer4
from supersampler_model.methods.guided_flow import GuidedFlow
from supersampler_model.methods.guided_warp import GuidedWarp
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.methods.spatial import Bicubic, Bilinear
from supersampler_model.methods.taa import Taa
from supersampler_model.methods.taau import Taau

METHODS: Mapping[str, type[Method]] = {m.name: m for m in (Bilinear, Bicubic, Taa, Taau, GuidedWarp)}
"""Methods without anything learned."""
LEARNED: Mapping[str, type[LearnedMethod]] = {
    m.name: m
    for m in (
        Classifier, SmallClassifier, PaperClassifier, Extrapolate,
        GBuffer, GBuffer4, SmallGBuffer, SmallGBuffer4, DepthGBuffer,
        GuidedFlow,
    )
}  # fmt: skip
"""Methods that are trained: `LEARNED[name].of(load_trained(path))`."""
