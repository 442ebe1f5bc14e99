"""Checks that read pixels and guess the mistake: docs/checks.md lists them all."""

from supersampler.checks.checker import FrameChecker, Validate

__all__ = ["FrameChecker", "Validate"]
