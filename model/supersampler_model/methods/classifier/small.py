"""`classifier-small`: `classifier` at half the width, for CPUs."""

from typing import ClassVar

from supersampler.methods.classifier.spec import CLASSIFIER_SMALL
from supersampler_model.methods.classifier.model import Classifier


class SmallClassifier(Classifier):
    """`Classifier` with a smaller network and fewer blended colours."""

    spec: ClassVar = CLASSIFIER_SMALL
