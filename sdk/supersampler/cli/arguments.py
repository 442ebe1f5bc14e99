"""Arguments that several commands share, and how their texts are read."""

import re
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, cast

import typer

from supersampler.errors import ArgumentError
from supersampler.frame import Size

if TYPE_CHECKING:
    from supersampler.io.shot import Shot
    from supersampler.model import Skip

ShotArgument = Annotated[str, typer.Argument(metavar="SHOT", help="A shot, or the name of a shipped one.")]


class Validate(StrEnum):
    """How much of each frame is checked."""

    off = "off"
    warn = "warn"
    strict = "strict"


class PrecisionName(StrEnum):
    """What is learned runs in."""

    auto = "auto"
    fp32 = "fp32"
    fp16 = "fp16"
    int8 = "int8"


class ExecutorChoice(StrEnum):
    """How a model runs."""

    auto = "auto"
    onnx = "onnx"
    cpu = "cpu"


class PresetChoice(StrEnum):
    """Settings that lead in run time against error."""

    fast = "fast"
    balanced = "balanced"
    high = "high"


class Format(StrEnum):
    """Image file formats."""

    exr = "exr"
    png = "png"


def open_shot(text: str) -> "Shot":
    """Open a shot of any layout, or the shipped one of that name.

    Raises:
        ShotError: nothing that is known lies there.
    """
    from supersampler.io.shot import open_source

    return open_source(text)


def parse_size(text: str) -> Size:
    """Read "1920x1080" as (1920, 1080).

    Raises:
        ArgumentError: it is not two whole numbers >= 1 with an x between.
    """
    found = re.fullmatch(r"\s*([1-9]\d*)\s*[xX×]\s*([1-9]\d*)\s*", text)
    if found is None:
        raise ArgumentError("--display-size", got=repr(text), want="WIDTHxHEIGHT in pixels, 1920x1080 say")
    return int(found[1]), int(found[2])


def parse_providers(text: str) -> str | list[str]:
    """Read "cuda,cpu" as names in order; one alone is not listed, as "auto" is no name in a list."""
    names = [name.strip() for name in text.split(",")]
    return names[0] if len(names) == 1 else names


def parse_skip(text: str) -> "Skip":
    """Read "auto", "exact" or a number, which `Upscaler` checks."""
    if text in ("auto", "exact"):
        return cast("Skip", text)
    try:
        return float(text)
    except ValueError:
        raise ArgumentError("--skip", got=repr(text), want="auto, exact or a number in [0, 1]") from None


def printable(text: str) -> str:
    """Return a text as one line; names in a stranger's file have no say over the terminal."""
    return "".join(character if character.isprintable() else "?" for character in text)


def size_text(size: Size | None) -> str:
    """Write (1920, 1080) as "1920x1080"."""
    return "none" if size is None else f"{size[0]}x{size[1]}"
