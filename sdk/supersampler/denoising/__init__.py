"""Temporal denoising of path-traced frames: `denoise_sequence`."""

from supersampler.denoising.sequence import denoise_sequence

__all__ = ["denoise_sequence"]
