"""Conversion of frames between the conventions of engines: units, signs, axes, jitter, depth.

docs/conventions.md describes them.
"""

from supersampler.conventions.camera_motion import camera_motion
from supersampler.conventions.conventions import PRESETS, Conventions, Converter, RawFrame
from supersampler.conventions.jitter import (
    halton_jitter,
    jitter_phase_count,
    jittered_projection,
    mip_bias,
    render_size_for,
)

__all__ = [
    "PRESETS",
    "Conventions",
    "Converter",
    "RawFrame",
    "camera_motion",
    "halton_jitter",
    "jitter_phase_count",
    "jittered_projection",
    "mip_bias",
    "render_size_for",
]
