"""The methods as torch modules: in each folder `model.py` has the stages, `network.py` the network.

`METHODS` and `LEARNED` find the methods by name.
"""

from collections.abc import Mapping

from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.classifier_large.model import LargeClassifier
from supersampler_model.methods.classifier_paper.model import PaperClassifier
from supersampler_model.methods.extrapolation.guided_flow import GuidedFlow
from supersampler_model.methods.extrapolation.guided_warp import GuidedWarp
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
from supersampler_model.methods.spatial.model import Bicubic, Bilinear
from supersampler_model.methods.taa.model import Taa
from supersampler_model.methods.taau.model import Taau

METHODS: Mapping[str, type[Method]] = {m.name: m for m in (Bilinear, Bicubic, Taa, Taau, GuidedWarp)}
"""Methods without a network."""
LEARNED: Mapping[str, type[LearnedMethod]] = {
    m.name: m
    for m in (
        Classifier, SmallClassifier, LargeClassifier, PaperClassifier, Extrapolate,
        GBuffer, GBuffer4, SmallGBuffer, SmallGBuffer4, DepthGBuffer,
        GuidedClassifier, GuidedFlow,
    )
}  # fmt: skip
"""Methods with a network: `LEARNED[name].of(load_trained(path))`."""
