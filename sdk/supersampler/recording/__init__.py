"""Recordings: every call of an Upscaler in a shot folder, for `supersampler replay`; docs/replay.md.

Here live the writer, which `Upscaler` uses, and the reader; pixels are written and read by `io`.
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
