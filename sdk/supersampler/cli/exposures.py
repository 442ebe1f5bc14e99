"""`supersampler exposures`: measures the exposures of a shot once, for chunks on many machines."""

from pathlib import Path
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
)


def exposures(
    shot: ShotArgument,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="JSON file to write.")],
    layout: LayoutOption = "auto",
    jitter: JitterOption = None,
    channels: ChannelsOption = None,
    conventions: ConventionsOption = None,
    frame_rate: FrameRateOption = None,
    cuts: CutsOption = None,
    reference: ReferenceOption = None,
    color_space: ColorSpaceOption = None,
) -> None:
    """Measure the exposure of each frame of SHOT, for `supersampler upscale --frames --exposures FILE`.

    Exposure that is not given with the frames is measured, and follows the light with a delay: it depends on
    all frames since the last cut. With this file a chunk of the shot begins with the exposure that the whole
    shot has there. The options of the source are those of `upscale`.

    \b
    Example:
      supersampler exposures renders/kitchen -o kitchen.exposures.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from rich.console import Console
    from rich.progress import Progress

    from supersampler.io.atomic import check_ours
    from supersampler.io.shot.exposures import is_exposures, measure_exposures, write_exposures

    check_ours(output, is_exposures, "a file of exposures")
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
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("measuring", total=len(opened))
        found = measure_exposures(opened, 0, len(opened), lambda: progress.advance(task))
    write_exposures(output, found)
    typer.echo(f"{len(found)} exposures: {output}")
