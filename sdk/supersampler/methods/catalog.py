"""The specs of all methods by kind, for commands that must not import torch."""

from collections.abc import Iterable, Mapping

from supersampler.methods.classifier.spec import CLASSIFIER, CLASSIFIER_PAPER, CLASSIFIER_SMALL
from supersampler.methods.classifier_large.spec import CLASSIFIER_LARGE
from supersampler.methods.extrapolation.spec import EXTRAPOLATE, GUIDED_FLOW, GUIDED_WARP
from supersampler.methods.gbuffer.spec import (
    GBUFFER,
    GBUFFER_4X,
    GBUFFER_DEPTH,
    GBUFFER_SMALL,
    GBUFFER_SMALL_4X,
)
from supersampler.methods.gbuffer_fast.spec import GBUFFER_FAST
from supersampler.methods.spatial.spec import BICUBIC, BILINEAR
from supersampler.methods.spec import MethodSpec
from supersampler.methods.taa.spec import TAA
from supersampler.methods.taau.spec import TAAU


def _by_name(*specs: MethodSpec) -> Mapping[str, MethodSpec]:
    return {spec.name: spec for spec in specs}


FIXED = _by_name(BILINEAR, BICUBIC, TAA, TAAU, GUIDED_WARP)
"""Methods without a network."""
UNTRAINED = _by_name(CLASSIFIER_PAPER, GBUFFER, GBUFFER_4X, GBUFFER_DEPTH)
"""Methods that can be trained, and of which no weights ship."""
LEARNED = {
    **_by_name(CLASSIFIER, CLASSIFIER_SMALL, CLASSIFIER_LARGE, EXTRAPOLATE),
    **_by_name(GBUFFER_FAST, GBUFFER_SMALL, GBUFFER_SMALL_4X, GUIDED_FLOW),
    **UNTRAINED,
}
"""Methods that are trained."""


def listed_methods(names: Iterable[str]) -> str:
    """Return names with commas between; those without shipped weights are marked."""
    return ", ".join(f"{name} (no weights ship)" if name in UNTRAINED else name for name in names)
