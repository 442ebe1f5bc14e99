"""The SHOT argument and options that open it: one shot, or the five test shots."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.cli.arguments import open_shot
from supersampler.errors import ArgumentError
from supersampler.io.shot import Shot
from supersampler_bench.cli.options import listed, warn
from supersampler_bench.shots import public_shots
from supersampler_bench.shots.public_shots import PublicShot

SHOT = Annotated[
    str,
    typer.Argument(
        metavar="SHOT",
        help=f"A shot, the name of a shipped one, or {public_shots.NAME}: the five of `bench shots`.",
    ),
]
RATIO = Annotated[str, typer.Option(help="Of the test shots: display over render size, with commas between.")]
CACHE_HELP = "Where the test shots are kept."
CACHE = Annotated[
    Path | None,
    typer.Option(envvar=public_shots.CACHE_VARIABLE, help=CACHE_HELP, show_default="the user's cache folder"),
]


def opened_shots(shot: str, cache: Path | None, ratio: str) -> tuple[str, list[tuple[Shot, dict[str, Any]]]]:
    """Open what SHOT names: its name, and each shot with what else is known of its pixels.

    Raises:
        ArgumentError: the ratios are no numbers, or there is no such shot.
        ShotError: the test shots are not there.
    """
    if shot != public_shots.NAME:
        one = open_shot(shot)
        return one.name, [(one, {})]
    try:
        ratios = [float(text) for text in listed(ratio)]
    except ValueError as error:
        raise ArgumentError("--ratio", got=repr(ratio), want="numbers with commas between: 1.5,2") from error
    found = found_test_shots(cache or public_shots.default_cache(), ratios)
    warn_of(found)
    return shot, [(public.shot, public.origin()) for public in found]


def found_test_shots(cache: Path, ratios: Sequence[float]) -> list[PublicShot]:
    """Return the test shots that are kept in a folder.

    Raises:
        ShotError: one of them is not there.
    """
    return public_shots.open_test_shots(cache, ratios, public_shots.TEST_SHOTS, public_shots.FROZEN)


def warn_of(shots: Sequence[PublicShot]) -> None:
    """Say which of them have other pixels than the frozen ones."""
    for warning in filter(None, (shot.warning() for shot in shots)):
        warn(warning)
