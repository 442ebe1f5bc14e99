"""`supersampler check`."""

from typing import Annotated

import typer

from supersampler.cli.arguments import ShotArgument, open_shot, printable


def check(
    shot: ShotArgument,
    frames: Annotated[int, typer.Option(min=2, help="How many from the middle to read.")] = 6,
) -> None:
    """Find out in which conventions SHOT is: motion, jitter and depth, by what fits the images.

    Tries motion units, directions and flips, and jitter units, signs and flips, on a few frames, and ranks
    them by how well they reproject each image to the next. Prints what fits, by how much, and the
    Conventions to write; and which G-buffers the first frame has. Exit code 1 where what fits contradicts
    what the shot says.

    \b
    Example:
      supersampler check shots/kitchen
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.methods.gbuffers import listed, names_of
    from supersampler.validation import detect_conventions

    opened = open_shot(shot)
    detection = detect_conventions(opened, frames=frames)
    typer.echo(f"{printable(opened.name)}: {min(frames, len(opened))} of {len(opened)} frames")
    typer.echo(f"G-buffers: {listed(names_of(opened.read_raw(0)))}")
    typer.echo(detection.summary())
    if not detection.agrees:
        raise typer.Exit(1)
