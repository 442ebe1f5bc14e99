"""Shared options of the commands, progress bars, and output of records and tables."""

import math
from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast

import typer

from supersampler.arguments import ExecutorName
from supersampler.cli import terminal
from supersampler.cli.arguments import folder_path, parse_size
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.files import check_ours
from supersampler.io.shot import Shot, open_source
from supersampler_bench.record import BenchRecord, is_record, write_json
from supersampler_bench.shots import public_shots

ERRORS = terminal.Terminal(stderr=True)
counted = partial(terminal.counted, ERRORS)
REFERENCES = "{scene}-reference*/*.exr"
"""Default pattern of the references of `bench denoise`."""
T = TypeVar("T")


def _checked_json(path: Path | None) -> Path | None:
    """Fail before the measurement, not after it, if this file exists and is not a record."""
    if path is not None:
        check_ours(path, is_record, "a record of `bench ... --json`")
    return path


def _checked_figures(folder: Path | None) -> Path | None:
    """Fail before the measurement, not after it, without matplotlib or if a file has the folder's name."""
    if folder is not None:
        import matplotlib  # noqa: F401

        check_ours(folder / "figure.png", lambda _: True, "a figure")
    return folder


JSON = Annotated[
    Path | None, typer.Option(help="Write all values and their setting here.", callback=_checked_json)
]
FIGURES = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--output",
        metavar="FOLDER",
        parser=folder_path,
        help="Folder for figures.",
        callback=_checked_figures,
    ),
]
METHODS = Annotated[str, typer.Option(help="Shipped models or model folders, comma-separated.")]
DISPLAY_SIZE = Annotated[str, typer.Option(help="Size of the images, as 960x540.")]
DISPLAY_SIZES = Annotated[str, typer.Option(help="Display sizes, comma-separated.")]
ONE_RATIO = Annotated[float, typer.Option(min=1.0, help="Display over render size.")]
THREADS = Annotated[str | None, typer.Option(help="CPU threads, comma-separated.", show_default="all cores")]
STEPS = Annotated[int, typer.Option(min=1, help="Timed steps of each setting.")]
SAMPLES = Annotated[int, typer.Option(min=1, help="Samples per pixel of the references.")]
EXECUTORS = Annotated[str, typer.Option(help="cpu, onnx, gpu, comma-separated.")]
SHOT = Annotated[
    str,
    typer.Argument(
        metavar="SHOT",
        help=f"A shot, the name of a shipped one, or of `bench shots`: {public_shots.NAME} (five), "
        f"{', '.join(name for s in public_shots.APART_SHOTS for name in s.seeds)}.",
    ),
]
RATIO = Annotated[
    str | None,
    typer.Option(help="Display over render size of test shots, comma-separated.", show_default="2"),
]
RATIOS = Annotated[str, typer.Option(help="Display over render size, comma-separated.")]
_CACHE_SOURCE: Any = {
    "envvar": public_shots.CACHE_VARIABLE,
    "metavar": "FOLDER",
    "parser": folder_path,
    "help": "Folder of the test shots.",
    "show_default": "the user's cache folder",
}
CACHE = Annotated[Path | None, typer.Option(**_CACHE_SOURCE)]
CACHE_ARGUMENT = Annotated[Path | None, typer.Argument(**_CACHE_SOURCE)]


def say(text: str) -> None:
    """Print a line on the error stream."""
    ERRORS.print(text, soft_wrap=True)


def warn(text: str) -> None:
    """Print a warning."""
    ERRORS.print(f"warning: {text}", style="yellow", soft_wrap=True)


def split_list(text: str) -> list[str]:
    """Split a text at commas."""
    return [part.strip() for part in text.split(",")]


def size_list(option: str, text: str) -> list[Size]:
    """Return the sizes of an option."""
    return [parse_size(part, option) for part in split_list(text)]


def ratio_list(text: str) -> list[float]:
    """Return the ratios of `--ratio`.

    Raises:
        ArgumentError: a part is not a number from 1 to 4.
    """
    try:
        ratios = [float(part) for part in split_list(text)]
    except ValueError:
        ratios = [math.nan]
    if not all(1.0 <= ratio <= 4.0 for ratio in ratios):  # NaN fails, too
        raise ArgumentError("--ratio", got=repr(text), want="numbers from 1 to 4 with commas between: 1.5,2")
    return ratios


def count_list(option: str, text: str) -> list[int]:
    """Return the counts of an option.

    Raises:
        ArgumentError: a part is not a whole number of at least 1.
    """
    parts = split_list(text)
    if not all(part.isdecimal() and int(part) for part in parts):
        raise ArgumentError(option, got=repr(text), want="numbers of at least 1 with commas between: 1,2")
    return [int(part) for part in parts]


def words_of(option: str, text: str, known: Sequence[T]) -> list[T]:
    """Return the words of an option.

    Raises:
        ArgumentError: one of them is not in `known`.
    """
    words = split_list(text)
    if not set(words) <= set(known):
        want = f"comma-separated words of {', '.join(map(str, known))}"
        raise ArgumentError(option, got=repr(text), want=want)
    return [cast("T", word) for word in words]


def executors_of(text: str) -> list[ExecutorName]:
    """Return the executors of an option."""
    kinds: Sequence[ExecutorName] = ("cpu", "onnx", "gpu")
    return words_of("--executors", text, kinds)


def publish(record: BenchRecord, name: str, json: Path | None, *, unprinted: Collection[str] = ()) -> None:
    """Print the tables of a record, except some blocks, and write it to `json`.

    `name` is the name of its first block, such as "latency".
    """
    texts = record.tables(name)
    printed = [text for block, text in texts.items() if block not in unprinted and text]
    terminal.Terminal().print("\n\n".join(printed), soft_wrap=True)
    if json is not None:
        write_json(record, json)


def opened_shots(
    shot: str, cache: Path | None, ratio: str | None
) -> tuple[str, list[tuple[Shot, dict[str, Any]]]]:
    """Open the SHOT argument; return its name, and each shot with its `PublicShot.origin`.

    Raises:
        ArgumentError: a ratio is not a number, or is given for another shot than a test shot.
        ShotError: the test shots are missing.
    """
    shots = public_shots.shots_named(shot)
    if shots is None:
        if ratio is not None:
            raise ArgumentError(
                "--ratio", got=repr(ratio), want=f"none: {shot} is no test shot, and has its own"
            )
        one = open_source(shot)
        return one.name, [(one, {})]
    ratios = ratio_list("2" if ratio is None else ratio)
    folder = cache or public_shots.default_cache()
    found = public_shots.open_test_shots(folder, ratios, shots, public_shots.FROZEN)
    for public in found:
        if warning := public.warning():
            warn(warning)
    return shot, [(public.shot, public.origin()) for public in found]
