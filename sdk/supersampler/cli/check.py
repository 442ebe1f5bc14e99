"""`supersampler check`."""

from typing import Annotated, Any

import typer

from supersampler.cli.arguments import ShotArgument, open_shot, printable


def check(
    shot: ShotArgument,
    frames: Annotated[int, typer.Option(min=2, help="How many from the middle to look at.")] = 6,
) -> None:
    """Detect the conventions of SHOT: motion, jitter and depth that fit its images best.

    Tries motion units, directions and flips, and jitter units, signs and flips, on a few frames, and ranks
    them by how well they reproject each image to the next. Prints what fits, by how much, and the Conventions
    to write; and which G-buffers the first frame has. Exit code 1 where what fits contradicts what the shot
    says.

    \b
    Example:
      supersampler check shots/kitchen
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.methods.gbuffers import listed, names_of
    from supersampler.validation import detect_conventions

    opened = open_shot(shot)
    detection = detect_conventions(opened, frames=frames)
    typer.echo(f"{printable(opened.name)}: {min(frames, len(opened))} of {len(opened)} frames")
    for row in detection.rows():
        typer.echo(f"  {row['name']:7} {_verdict(row)}")
    typer.echo(f"  gbuffer {listed(names_of(opened.read_raw(0)))}")
    for note in detection.notes:
        typer.echo(f"  {note}")
    if detection.agrees:
        typer.echo(f"The shot says the same: {detection.call}")
        return
    typer.echo(f"The shot says {detection.stated!r}. Write instead:\n{detection.call}")
    raise typer.Exit(1)


def _verdict(row: dict[str, Any]) -> str:
    if not row["certain"]:
        return f"cannot tell: {row['reason']}"
    return f"{row['found']}; its error is {row['margin']:.2f} times smaller than that of: {row['runner_up']}"
