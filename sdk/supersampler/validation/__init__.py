"""Pixel checks that find likely mistakes in frames (docs/checks.md), and detection of conventions."""

from supersampler.validation.checker import FrameChecker
from supersampler.validation.detection import detect_conventions
from supersampler.validation.rankings import Detection, Hypothesis, Verdict

__all__ = ["Detection", "FrameChecker", "Hypothesis", "Verdict", "detect_conventions"]
