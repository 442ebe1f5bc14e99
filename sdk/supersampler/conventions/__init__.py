"""Other engines' frames to ours and back: units, signs, axes, jitter, depth; see docs/conventions.md.

Numbers and arrays in, numbers and arrays out: no file is read here.
"""

from supersampler.conventions.conventions import Conventions
from supersampler.conventions.converter import Converter
from supersampler.conventions.raw_frame import RawFrame

__all__ = ["Conventions", "Converter", "RawFrame"]
