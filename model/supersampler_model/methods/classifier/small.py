"""`classifier-small`: `classifier` at half the width, for CPUs."""

from dataclasses import dataclass, field
from typing import ClassVar

from supersampler_model.methods.classifier.model import Classifier, ClassifierConfig
from supersampler_model.methods.classifier.network import NetworkConfig

NETWORK = NetworkConfig(levels=(16, 32, 64, 128), decoder=16, hidden=26)


@dataclass(frozen=True)
class SmallConfig(ClassifierConfig):
    """Constants.

    Attributes:
        network: its widths.
        rectified, own_motion, corrected: off; they cost time and gain little with this network.
    """

    network: NetworkConfig = field(default_factory=lambda: NETWORK)
    rectified: bool = False
    own_motion: bool = False
    corrected: bool = False


class SmallClassifier(Classifier):
    """`Classifier` with a smaller network and fewer blended colours."""

    name = "classifier-small"
    settings: ClassVar[type[ClassifierConfig]] = SmallConfig
