"""Automatic labels of pixels: where history is invalid (ghosting) and where one sample aliases.

>>> labels = label(now, before)  # two `Evidence`: statistics, motion, expected previous depth
>>> labels.ghost, labels.alias   # (H, W) uint8 each
"""

from supersampler_model.data.labels.rules import DEFAULTS, Alias, Ghost, Labels, LabelThresholds, label
from supersampler_model.data.labels.statistics import Evidence, PixelStatistics, Sample, statistics_of, toned

__all__ = [
    "DEFAULTS",
    "Alias",
    "Evidence",
    "Ghost",
    "LabelThresholds",
    "Labels",
    "PixelStatistics",
    "Sample",
    "label",
    "statistics_of",
    "toned",
]
