"""Convert frames between the conventions of engines: units, signs, axes, jitter, depth; docs/conventions.md.

No file is read here.
"""

from supersampler.conventions.conventions import Conventions
from supersampler.conventions.converter import Converter
from supersampler.conventions.jitter import (
    halton_jitter,
    jitter_phase_count,
    jittered_projection,
    mip_bias,
    render_size_for,
)
from supersampler.conventions.raw_frame import RawFrame

__all__ = [
    "Conventions",
    "Converter",
    "RawFrame",
    "halton_jitter",
    "jitter_phase_count",
    "jittered_projection",
    "mip_bias",
    "render_size_for",
]
