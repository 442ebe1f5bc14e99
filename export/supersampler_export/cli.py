"""`supersampler export METHOD -o FOLDER`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.errors import ArgumentError
from supersampler_export.folder import write_model_folder
from supersampler_model.methods import LEARNED, METHODS
from supersampler_model.methods.base import Method
from supersampler_model.methods.weights_file import load_trained, shipped_weights

app = typer.Typer(help="Write a method as a model folder for ONNX Runtime.")


@app.command()
def export(
    method: Annotated[
        str,
        typer.Argument(help=f"One of {', '.join([*METHODS, *LEARNED])}; `all`: those that are released."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write; with `all`, its parent.")],
    weights: Annotated[
        Path | None,
        typer.Option(
            help="Weights of a learned method: weights.safetensors of a run, in place of the released ones."
        ),
    ] = None,
) -> None:
    """Write METHOD as a model folder: step.onnx (the whole recurrent step), model.json and a model card.

    The files are written only after ONNX Runtime reproduces the images of torch, at sizes not traced.

    Examples:
      supersampler export taau -o my_taau
      supersampler export classifier --weights run/weights.safetensors -o my_classifier
      supersampler upscale SHOT --model my_taau -o out
    """
    console = Console()
    for name in shipped_methods() if method == "all" else [method]:
        folder = output / name if method == "all" else output
        made = made_method(name, weights)
        with console.status(f"exporting {name}"):
            write_model_folder(made, folder)
        console.print(f"{name}: {folder}")


def shipped_methods() -> list[str]:
    """Names of the released methods: those without weights, and those with released weights."""
    return [*METHODS, *(name for name in LEARNED if shipped_weights(name).exists())]


def made_method(name: str, weights: Path | None = None) -> Method:
    """Return a method with the weights of a file, or with its released ones.

    Raises:
        ArgumentError: there is no such method, or it has no weights.
    """
    if name in LEARNED and (weights is not None or shipped_weights(name).exists()):
        return LEARNED[name].of(load_trained(weights or shipped_weights(name)))
    if name in METHODS and weights is None:
        return METHODS[name]()
    if name in {*METHODS, *LEARNED}:
        want = "none, as nothing in it is learned" if name in METHODS else "a file, as none ship"
        raise ArgumentError("--weights", got=weights, want=want)
    raise ArgumentError("METHOD", got=name, want=f"one of {', '.join([*METHODS, *LEARNED])}, or all")
