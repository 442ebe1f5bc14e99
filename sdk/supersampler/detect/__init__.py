"""The convention detector: docs/conventions.md tells how it works and what it cannot see."""

from supersampler.detect.detection import Detection, Hypothesis, Verdict
from supersampler.detect.detector import detect_conventions

__all__ = ["Detection", "Hypothesis", "Verdict", "detect_conventions"]
