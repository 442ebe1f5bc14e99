"""The command group: global options, one-line errors, signals, and commands of other packages."""

import os
import re
import signal
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Thread, main_thread
from types import FrameType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from supersampler import __version__
from supersampler.cli.terminal import echo
from supersampler.errors import ArgumentError, SupersamplerError, did_you_mean

TOOLS = {
    "render": (
        "supersampler_model.data.cli",
        "Render a training set with exact ground truth and labels. Needs moderngl.",
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
"""Commands of other packages: module of their `app`, imported when the command runs, and help text."""
EXTRAS = {
    "av": "video",
    "torch": "train",
    "onnx": "train",
    "onnxscript": "train",
    "tensorboard": "train",
    "matplotlib": "bench",
    "flip_evaluator": "bench",
    "pycvvdp": "cvvdp",
    "pyoidn": "denoise",
    "wgpu": "gpu",
    "moderngl": "render",
}
"""Optional packages, and the extra that installs each."""
END_WITH_STDIN = "SUPERSAMPLER_END_WITH_STDIN"
"""Environment variable: the command stops, as after Ctrl-C, when its standard input closes.

A program that runs a command keeps the other end of this pipe open, and closes it to stop the command. The
pipe also closes when that program ends. This works where SIGINT is ignored or, as on Windows, cannot be sent.
"""
_INTERRUPTED = 128 + signal.SIGINT
_PIPE_CLOSED = 128 + 13  # SIGPIPE, which stops other programs: what the command does is not done
_MAX_LINE, _END = 2000, 500  # characters of an error, and of its end
_received = [int(signal.SIGINT)]


class Commands(TyperGroup):
    """Command group that finds commands of other packages, and prints expected errors as one line."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Resolve a command of another package to its real implementation."""
        if args and args[0] in TOOLS:
            command = typer.main.get_command(import_module(TOOLS[args[0]][0]).app)
            return args[0], command, args[1:]
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        """Run a command."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = error.message.removeprefix("Value error, ")  # of pydantic, in newer typer
            given, _, choices = error.message.partition(" is not one of ")
            hint = did_you_mean(given.rpartition("'")[0].rpartition("'")[2], re.findall("'(.*?)'", choices))
            error.message = f"{error.message} {hint}".rstrip()
            raise
        except BrokenPipeError:  # `| head` has read enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Python flushes the rest at its end
            raise typer.Exit(_PIPE_CLOSED) from None
        except (SupersamplerError, ModuleNotFoundError, OSError, UnicodeDecodeError, MemoryError) as error:
            line = _line(error)
            if line is None or ctx.params.get("debug"):
                raise
            if isinstance(error, ArgumentError):
                command = self.resolve_command(ctx, [ctx.invoked_subcommand or ""])[1]
                line = _with_option(line, error.name, command)
            if len(line) > _MAX_LINE:  # it quotes much of a file; the remedy is at the end
                line = f"{line[: _MAX_LINE - _END]} ... {line[-_END:]}"
            echo(f"error: {line}", err=True)
            raise typer.Exit(2 if isinstance(error, ArgumentError) else 1) from None
        except KeyboardInterrupt:
            echo("stopped", err=True)
            raise typer.Exit(130) from None


app = typer.Typer(cls=Commands, no_args_is_help=True, add_completion=False, rich_markup_mode=None)


def main() -> None:
    """Run the command line and exit; the exit code is 128 + n if signal n stopped the command."""
    stop_on_signals()
    try:
        typer.main.get_command(app)(prog_name="supersampler")
    except SystemExit as end:
        sys.exit(128 + _received[-1] if end.code == _INTERRUPTED else end.code)
    except KeyboardInterrupt:  # before a command was invoked
        echo("stopped", err=True)
        sys.exit(128 + _received[-1])
    except OSError as error:  # the text of --help or --version cannot be printed
        if "--debug" in sys.argv:
            raise
        echo(f"error: {_line(error)}", err=True)
        sys.exit(1)


def stop_on_signals() -> None:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt unless they are ignored; a second one kills at once."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)
    if os.environ.pop(END_WITH_STDIN, "") and sys.stdin is not None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        Thread(target=_interrupt_when_stdin_closes, name="stdin", daemon=True).start()


def _line(error: Exception) -> str | None:
    """Return the line to print for an error; None if it is a bug, such as a missing required module."""
    match error:
        case SupersamplerError():
            return str(error)
        case FileNotFoundError(filename=None) if _is_working_directory_gone():
            return "the working directory no longer exists. Change to another one."
        case OSError():
            return f"{error.filename}: {error.strerror}" if error.filename else str(error)
        case UnicodeDecodeError():
            return f"a file that should hold text does not ({error})"
        case MemoryError():
            return f"there is not enough memory for this. {error}".rstrip()
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if package not in EXTRAS:
        return None
    install = f'pip install "supersampler[{EXTRAS[package]}]"'
    return f"this command needs {package}, which is not installed. Install it: {install}"


def _is_working_directory_gone() -> bool:
    try:
        Path.cwd()
    except FileNotFoundError:
        return True
    return False


def _with_option(line: str, argument: str, command: Any) -> str:
    """Return an error about an argument with the name of the command's option for it, if there is one."""
    name = argument.partition("[")[0]
    options = {each.name: each.opts[-1] for each in command.params if each.opts[-1].startswith("--")}
    option = options.get("channels" if name == "channel_map" else name)
    return line if option is None else option + line.removeprefix(name)


def _interrupt(number: int, _: FrameType | None) -> None:
    _received.append(number)
    signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def _interrupt_when_stdin_closes() -> None:
    with suppress(OSError):
        while os.read(0, 4096):
            pass
    if hasattr(signal, "pthread_kill") and main_thread().ident is not None:  # interrupts a blocking call
        signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)


def _print_version(requested: bool) -> None:
    if requested:
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
