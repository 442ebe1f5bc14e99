"""One file per method; `METHODS` finds them by name."""

from collections.abc import Mapping

from supersampler_model.method import Method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.classifier_small import SmallClassifier
from supersampler_model.methods.spatial import Bicubic, Bilinear
from supersampler_model.methods.taa import Taa
from supersampler_model.methods.taau import Taau

METHODS: Mapping[str, type[Method]] = {m.name: m for m in (Bilinear, Bicubic, Taa, Taau)}
"""Methods without anything learned."""
LEARNED: Mapping[str, type[Classifier]] = {m.name: m for m in (Classifier, SmallClassifier, PaperClassifier)}
"""Methods that are trained: `LEARNED[name].of(load_trained(path))`."""
