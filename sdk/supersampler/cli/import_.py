"""`supersampler import`: copies frames of other programs into a shot."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import size_text
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


def import_shot(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Folder of frames, pattern such as beauty.####.exr, or .safetensors.",
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="SHOT", help="Folder to write.")],
    layout: LayoutOption = "auto",
    jitter: JitterOption = None,
    channels: ChannelsOption = None,
    conventions: ConventionsOption = None,
    frame_rate: FrameRateOption = None,
    cuts: CutsOption = None,
    reference: ReferenceOption = None,
    color_space: ColorSpaceOption = None,
) -> None:
    """Copy frames of other programs into a shot of this package's format.

    Pixels are not converted: the shot states their conventions, and `supersampler check` tests them. Motion
    and depth packed into 8-bit channels are unpacked as --channels says (docs/shots.md), and what such files
    lose is printed. A run that was stopped continues when the same command is given again.

    \b
    Examples:
      supersampler import renders/kitchen -o shots/kitchen --jitter jitter.json
      supersampler import "out/beauty.####.exr" -o shots/city --conventions unreal
      supersampler import unreal_out -o shots/city --channels map.json --conventions unreal
      supersampler import village_png -o shots/village --channels packed.json --conventions uv.json
      supersampler import 0001.safetensors -o shots/arm
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.cli.terminal import Terminal
    from supersampler.io.shot import copy_shot

    shot = open_with(
        source,
        layout=layout,
        jitter=jitter,
        channels=channels,
        conventions=conventions,
        frame_rate=frame_rate,
        cuts=cuts,
        reference=reference,
        color_space=color_space,
    )
    with Terminal(stderr=True).status(f"copying {len(shot)} frames"):
        written = copy_shot(shot, output, resume=True)
    echo(f"{len(written)} frames of {size_text(written.render_size)} in {output}")
    for note in source_notes(shot):
        echo(note)
    echo(f"Next: supersampler check {output}")
