"""Pixel checks that find likely mistakes in frames, and detection of conventions.

They read frames only, independent of methods and Upscaler. See docs/checks.md and docs/conventions.md.
"""

from supersampler.validation.checker import FrameChecker, Validate
from supersampler.validation.detection import detect_conventions
from supersampler.validation.rankings import Detection, Hypothesis, Verdict

__all__ = ["Detection", "FrameChecker", "Hypothesis", "Validate", "Verdict", "detect_conventions"]
