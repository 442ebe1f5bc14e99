"""Types and parsers of command-line arguments that several commands share."""

import re
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from supersampler.errors import ArgumentError
from supersampler.frame import Size

if TYPE_CHECKING:
    from supersampler.io.shot import Shot

Compare = Annotated[bool, typer.Option("--compare", help="Also write compare.html (last 64 frames).")]
ShotArgument = Annotated[str, typer.Argument(metavar="SHOT", help="A shot, or the name of a shipped one.")]


# The same words as in the SDK's modules, which would take long to import for `--help`.
Validate = Literal["off", "warn", "strict"]
Precision = Literal["auto", "fp32", "fp16", "int8"]
Executor = Literal["auto", "onnx", "cpu", "cpu+onnx", "gpu"]
Preset = Literal["fast", "balanced", "high"]
AtRest = Literal["converge", "accumulate", "off"]


class ImageFormat(StrEnum):  # a Literal cannot be given several times
    """Formats of image files."""

    exr = "exr"
    png = "png"
    tif = "tif"


class Format(StrEnum):
    """Formats of results."""

    exr = "exr"
    png = "png"
    tif = "tif"
    mp4 = "mp4"


def open_shot(text: str) -> "Shot":
    """Open a shot of any layout, or a shipped one by name; ShotError where there is none."""
    from supersampler.io.shot import open_source

    return open_source(text)


def parse_size(text: str, option: str = "size") -> Size:
    """Parse "1920x1080" as (1920, 1080); ArgumentError, with the name of the option, for anything else."""
    found = re.fullmatch(r"\s*([1-9]\d*)\s*[xX×]\s*([1-9]\d*)\s*", text)
    if found is None:
        raise ArgumentError(option, got=repr(text), want="WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(found[1]), int(found[2])


def parse_providers(text: str) -> str | list[str]:
    """Parse "cuda,cpu" as a list of names; one name stays text, as "auto" is not allowed in a list."""
    names = [name.strip() for name in text.split(",")]
    return names[0] if len(names) == 1 else names


def size_text(size: Size | None) -> str:
    """Format (1920, 1080) as "1920x1080", and None as "none"."""
    return "none" if size is None else f"{size[0]}x{size[1]}"
