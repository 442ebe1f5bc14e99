"""Writes a small shot of a checkerboard that moves, with a reference on every frame."""

from pathlib import Path

from supersampler.io.shot import ClassMaps, ShotWriter
from supersampler_model.data.scenes.analytic import Plane, checker

DISPLAY = (80, 60)


def write_checker_shot(folder: Path, frames: int = 10, classes: ClassMaps | None = None) -> Path:
    """Write a shot named "own" at a ratio of 2; return its folder."""
    scene = Plane(checker, velocity=(1.0, 0.0))
    with ShotWriter(folder, name="own", display_size=DISPLAY, frame_rate=30) as writer:
        for index in range(frames):
            truth = scene.truth(index, DISPLAY, samples=2)
            writer.write(scene.frame(index, (40, 30)), reference=truth, classes=classes)
    return folder
