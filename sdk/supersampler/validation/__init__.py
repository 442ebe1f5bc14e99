"""What is wrong with frames: pixel checks that guess the mistake, and the detector of conventions.

Reads frames alone; knows no method, no history and no Upscaler. docs/checks.md, docs/conventions.md.
"""

from supersampler.validation.checker import FrameChecker, Validate
from supersampler.validation.detection import Detection, Hypothesis, Verdict
from supersampler.validation.detector import detect_conventions

__all__ = ["Detection", "FrameChecker", "Hypothesis", "Validate", "Verdict", "detect_conventions"]
