"""Pixel checks that find likely mistakes in frames, and detection of conventions.

They read frames only, independent of methods and Upscaler. See docs/checks.md and docs/conventions.md.
"""

from supersampler.validation.checker import FrameChecker, Validate
from supersampler.validation.detection import Detection, Hypothesis, Verdict
from supersampler.validation.detector import detect_conventions

__all__ = ["Detection", "FrameChecker", "Hypothesis", "Validate", "Verdict", "detect_conventions"]
