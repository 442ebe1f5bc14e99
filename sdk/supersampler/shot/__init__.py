"""Shots on disk: sequences of rendered frames, read lazily, written whole. docs/shots.md is the format."""

from supersampler.shot.arm import import_arm
from supersampler.shot.blender import import_blender
from supersampler.shot.channels import import_channels, import_described_channels
from supersampler.shot.format import FrameEntry, ShotInfo
from supersampler.shot.frame_files import ClassMaps
from supersampler.shot.shipped import shipped_shot
from supersampler.shot.shot import Shot, ShotFrame
from supersampler.shot.sources import open_source
from supersampler.shot.writer import ShotWriter, copy_shot

__all__ = [
    "ClassMaps",
    "FrameEntry",
    "Shot",
    "ShotFrame",
    "ShotInfo",
    "ShotWriter",
    "copy_shot",
    "import_arm",
    "import_blender",
    "import_channels",
    "import_described_channels",
    "open_source",
    "shipped_shot",
]
