"""Shots on disk: sequences of rendered frames, read lazily, written whole. docs/shots.md is the format."""

from supersampler.shot.shipped import shipped_shot
from supersampler.shot.shot import Shot, ShotFrame
from supersampler.shot.writer import ShotWriter, copy_shot

__all__ = ["Shot", "ShotFrame", "ShotWriter", "copy_shot", "shipped_shot"]
