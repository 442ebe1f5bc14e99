"""`classifier-small`: the `classifier` at half the width, for processors."""

from typing import ClassVar

from supersampler.methods.classifier.spec import CLASSIFIER_SMALL
from supersampler_model.methods.classifier.model import Classifier


class SmallClassifier(Classifier):
    """Classify, then compose, with less."""

    spec: ClassVar = CLASSIFIER_SMALL
