"""The times of the stages of a run, as a table."""

import os

from rich.table import Table

from supersampler.cli.terminal import Terminal
from supersampler.io.machine import StageTimes

_MEANINGS = {
    "read": "decode the files of a frame; on a thread of its own",
    "exposure": "measured of frames before the preroll",
    "convert": "to this package's conventions; on the same thread",
    "step": "upscale; its threads' CPU time is in the last line only",
    "page": "bicubic, and encode the images of compare.html",
    "write": "display transform, half floats or integers, compression, disk",
    "video": "encode",
}


def print_profile(console: Terminal, times: StageTimes, frames: int, wall: float, cpu: float) -> None:
    """Print the milliseconds of each stage, for each of its calls.

    Args:
        console: for people.
        times: of the stages.
        frames: number of frames that were stepped.
        wall: seconds of the run.
        cpu: seconds of CPU time of the process in it.
    """
    table = Table("stage", "wall ms", "CPU ms", "of the run", "", box=None)
    for name in (name for name in _MEANINGS if name in times.stages):
        stage = times.stages[name]
        each = (f"{1000 * seconds / stage.calls:.1f}" for seconds in (stage.wall, stage.cpu))
        table.add_row(name, *each, f"{stage.wall / wall:.0%}", _MEANINGS[name])
    all_of_it = f"{cpu / wall:.2f} of {os.cpu_count()} cores busy"
    table.add_row("all", f"{1000 * wall / frames:.1f}", f"{1000 * cpu / frames:.1f}", "100%", all_of_it)
    console.print(table)
