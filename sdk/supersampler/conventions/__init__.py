"""Other people's frames to ours and back: docs/conventions.md shows how, with the source of each preset."""

from supersampler.conventions.conventions import Conventions
from supersampler.conventions.converter import Converter
from supersampler.conventions.raw_frame import RawFrame

__all__ = ["Conventions", "Converter", "RawFrame"]
