"""Recordings: every call of an Upscaler in one file, for `supersampler replay`; docs/replay.md.

The recorder serves `Upscaler`; what reads a recording back is above it.
"""

from supersampler.recording.calls import Call, CloseCall, LoadStateCall, ResetCall, Setup, StepCall
from supersampler.recording.outcome import Outcome
from supersampler.recording.recording import Recording, open_recording

__all__ = [
    "Call",
    "CloseCall",
    "LoadStateCall",
    "Outcome",
    "Recording",
    "ResetCall",
    "Setup",
    "StepCall",
    "open_recording",
]
