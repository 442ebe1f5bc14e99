"""The exposures of a shot's frames, as a run from its first frame on has them; their file."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

from supersampler.errors import ShotError
from supersampler.io.atomic import write_text
from supersampler.io.display import EXPOSURES, ExposureMeter
from supersampler.io.json_fields import Field, read_json
from supersampler.io.limits import SHOT_FRAMES
from supersampler.io.shot.format import LARGEST_NUMBER
from supersampler.io.shot.shot import Shot

_KIND = "supersampler exposures"


def measure_exposures(
    shot: Shot, start: int, stop: int, on_frame: Callable[[], None] = lambda: None
) -> dict[int, float]:
    """Return the exposures of frames by their numbers: given by the frame, or measured and smoothed.

    Args:
        shot: the shot.
        start: index of the first frame; its exposure is that of a frame after a cut.
        stop: index after the last one.
        on_frame: called after each frame.

    Raises:
        ShotError: see `Shot.read`.
    """
    meter, exposures = ExposureMeter(), {}
    for item in shot.frames(start, stop, gbuffers=(), references=False):
        frame = item.frame
        exposure = meter.read(frame.color, given=frame.exposure, reset=frame.reset)
        exposures[shot.first_number + item.index] = exposure
        on_frame()
    return exposures


def write_exposures(path: Path, exposures: Mapping[int, float]) -> None:
    """Write the exposures of consecutive frames, by number, as JSON; ShotError where the disk refuses."""
    content = {"kind": _KIND, "first": min(exposures), "exposures": [exposures[n] for n in sorted(exposures)]}
    write_text(path, json.dumps(content) + "\n")


def read_exposures(path: Path) -> dict[int, float]:
    """Read exposures by frame number; ShotError where the file is missing, damaged or of something else."""
    if not is_exposures(path):
        raise ShotError(path, "holds no exposures", "Measure them: supersampler exposures SHOT -o FILE.")
    content = Field(path, "the file", read_json(path))
    first = content["first"].whole(0, LARGEST_NUMBER)
    values = content["exposures"].items(SHOT_FRAMES)
    return {first + i: float(value.number(*EXPOSURES)) for i, value in enumerate(values)}


def is_exposures(path: Path) -> bool:
    """Return whether a file holds exposures."""
    content = read_json(path)
    return isinstance(content, dict) and content.get("kind") == _KIND
