"""Recordings: all that an Upscaler was asked, in one file, for `supersampler replay`. docs/replay.md."""

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
