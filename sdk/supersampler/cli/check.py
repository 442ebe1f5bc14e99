"""`supersampler check`: detects the conventions of a shot."""

from typing import Annotated

import typer

from supersampler.cli.arguments import ShotArgument
from supersampler.cli.source_options import (
    ChannelsOption,
    ColorSpaceOption,
    ConventionsOption,
    CutsOption,
    FrameRateOption,
    JitterOption,
    LayoutOption,
    ReferenceOption,
    open_with,
    source_notes,
)
from supersampler.cli.terminal import echo


def check(
    shot: ShotArgument,
    layout: LayoutOption = "auto",
    jitter: JitterOption = None,
    channels: ChannelsOption = None,
    conventions: ConventionsOption = None,
    frame_rate: FrameRateOption = None,
    cuts: CutsOption = None,
    reference: ReferenceOption = None,
    color_space: ColorSpaceOption = None,
    frames: Annotated[int, typer.Option(min=2, help="Number of frames to read from the middle.")] = 6,
) -> None:
    """Detect the conventions of SHOT: motion, jitter and depth.

    Tries motion units, directions and flips, and jitter units, signs and flips, on a few frames, and ranks
    them by how well they reproject each image to the next. Prints the best, the margins and the Conventions
    to write, and the G-buffers of the first frame. Exit code 1 where they contradict the shot's own.

    \b
    Examples:
      supersampler check shots/kitchen
      supersampler check "out/beauty.####.exr" --conventions unreal --jitter jitter.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.methods.gbuffers import listed, names_of
    from supersampler.validation import detect_conventions

    opened = open_with(
        shot,
        layout=layout,
        jitter=jitter,
        channels=channels,
        conventions=conventions,
        frame_rate=frame_rate,
        cuts=cuts,
        reference=reference,
        color_space=color_space,
    )
    detection = detect_conventions(opened, frames=frames)
    echo(f"{opened.name}: {min(frames, len(opened))} of {len(opened)} frames")
    echo(f"G-buffers: {listed(names_of(opened.read_raw(0)))}")
    for note in source_notes(opened):
        echo(note)
    for line in detection.summary().splitlines():
        echo(line)
    if not detection.agrees:
        raise typer.Exit(1)
