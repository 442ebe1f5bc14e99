"""Temporal supersampling: aliased, jittered, low-resolution frames in, clean high-resolution frames out.

>>> from supersampler import Frame, Upscaler
>>> upscaler = Upscaler("taau", display_size=(1920, 1080))
>>> image = upscaler.step(frame)  # (1080, 1920, 3) float32, linear RGB
"""

from supersampler.errors import (
    ArgumentError,
    FrameError,
    FrameWarning,
    ModelError,
    ProviderError,
    ShotError,
    SupersamplerError,
)
from supersampler.frame import Frame

__version__ = "0.1.0"
__all__ = [
    "ArgumentError",
    "Frame",
    "FrameError",
    "FrameWarning",
    "ModelError",
    "ProviderError",
    "ShotError",
    "SupersamplerError",
]
