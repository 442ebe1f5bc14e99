"""Sequences whose later frames are known: `upscale_sequence` steps forward and backward, and merges."""

from supersampler.sequence.upscale_sequence import upscale_sequence

__all__ = ["upscale_sequence"]
