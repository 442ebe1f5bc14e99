"""The command group: global options, one-line errors, and the commands of other packages."""

import os
import re
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from supersampler import __version__
from supersampler.cli.stopping import exit_code, stop_on_signals
from supersampler.cli.terminal import echo
from supersampler.errors import SupersamplerError, did_you_mean

TOOLS = {
    "render": (
        "supersampler_model.data.cli",
        "Render a training set with exact truth and labels. Needs moderngl.",
    ),
    "train": (
        "supersampler_model.training.cli",
        "Train a method on rendered data or your own shots. Needs torch.",
    ),
    "export": (
        "supersampler_export.cli",
        "Write a method as a model folder for ONNX Runtime (needs torch), or its shaders for engines.",
    ),
    "bench": ("supersampler_bench.cli", "Measure methods against references. Needs flip-evaluator."),
}
"""Commands of other packages: the module with their `app`, imported when they are called, and their help."""

EXTRAS = {
    "av": "video",
    "torch": "train",
    "onnx": "train",
    "onnxscript": "train",
    "tensorboard": "train",
    "matplotlib": "bench",
    "flip_evaluator": "bench",
    "markdown_it": "bench",
    "wgpu": "gpu",
    "moderngl": "render",
    "safetensors": "render",
}
"""Packages that are missing in a runtime-only install, and the extra that installs each."""


class Commands(TyperGroup):
    """Finds commands of other packages, and prints expected errors as one line."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command of another package in place of its entry in `--help`."""
        if args and args[0] in TOOLS:
            command = typer.main.get_command(import_module(TOOLS[args[0]][0]).app)
            return args[0], command, args[1:]
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = _with_suggestion(error.message)
            raise
        except BrokenPipeError:  # `| head` has read enough
            _discard_output()
            raise typer.Exit(0) from None
        except (SupersamplerError, ModuleNotFoundError, OSError, UnicodeDecodeError, MemoryError) as error:
            line = _line(error)
            if line is None or ctx.params.get("debug"):
                raise
            echo(f"error: {line}", err=True)
            raise typer.Exit(1) from None
        except KeyboardInterrupt:
            echo("stopped", err=True)
            raise typer.Exit(130) from None


app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, rich_markup_mode=None)


def main() -> None:
    """Run the command line and exit."""
    stop_on_signals()
    try:
        typer.main.get_command(app)(prog_name="supersampler")
    except SystemExit as ended:
        sys.exit(exit_code(ended.code))


def _discard_output() -> None:
    """Send what is left of the output nowhere: Python flushes it at its end, and would complain."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _line(error: Exception) -> str | None:
    """Return the line to print for an error; None where it is a bug, such as a missing required module."""
    if isinstance(error, SupersamplerError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename else str(error)
    if isinstance(error, UnicodeDecodeError):
        return f"a file that should hold text does not ({error})"
    if isinstance(error, MemoryError):
        return f"there is not enough memory for this. {error}".rstrip()
    missing = missing_extra(error)
    return f"this command {missing}" if missing else None


def missing_extra(error: Exception) -> str:
    """Return "needs X, which is not installed" and the remedy, for an error of an import; "" for others."""
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if package not in EXTRAS:
        return ""
    install = f'pip install "supersampler[{EXTRAS[package]}]"'
    return f"needs {package}, which is not installed. Install it: {install}"


def _with_suggestion(message: str) -> str:
    """Append "Did you mean ...?" to "'x' is not one of 'a', 'b'"."""
    given, _, choices = message.partition(" is not one of ")
    word = given.rpartition("'")[0].rpartition("'")[2]
    hint = did_you_mean(word, re.findall("'(.*?)'", choices))
    return f"{message} {hint}".rstrip()


def _print_version(wanted: bool) -> None:
    if wanted:
        echo(f"supersampler {__version__}, Python {sys.version.split()[0]}")
        raise typer.Exit


@app.callback(epilog="Start with: supersampler demo")
def supersampler(
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of errors.")] = False,
    version: Annotated[
        bool, typer.Option("--version", help="Print versions.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Turn aliased, jittered, low-resolution rendered frames into clean high-resolution ones.

    SHOT is a folder with shot.json and EXR frames, a folder of Blender's multilayer EXR frames, EXR frames
    with a channels.json, an Arm .safetensors sequence, or the name of the shot that ships: plaza. Sizes
    are width x height in pixels.
    """
