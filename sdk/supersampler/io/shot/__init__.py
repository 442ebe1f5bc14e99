"""Shots: folders of rendered frames, read one at a time and written atomically; docs/shots.md.

The importers of other programs' files are here, too.
"""

from supersampler.io.shot.arm import import_arm
from supersampler.io.shot.blender import import_blender
from supersampler.io.shot.channels import import_channels, import_described_channels
from supersampler.io.shot.format import ClassMaps, FrameEntry, ShotInfo
from supersampler.io.shot.named_channels import import_named_channels
from supersampler.io.shot.shot import Shot, ShotFrame
from supersampler.io.shot.sources import open_source
from supersampler.io.shot.writer import ShotWriter, copy_shot

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
    "import_named_channels",
    "open_source",
]
