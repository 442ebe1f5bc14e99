"""Recordings of all calls of an Upscaler, written by it and read for `supersampler replay`; docs/replay.md.

A recording is a shot folder with a call log.
"""

from supersampler.recording.calls import Call, CloseCall, LoadStateCall, ResetCall, StepCall
from supersampler.recording.outcome import Outcome
from supersampler.recording.recording import Recording, open_recording
from supersampler.recording.setup import Setup

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
