"""Sequences whose later frames are known: `upscale_sequence` steps forward and backward, and merges.

The runs and their chunks are in both_ways.py, the merge in merge.py.
"""

from supersampler.sequence.upscaling import upscale_sequence

__all__ = ["upscale_sequence"]
