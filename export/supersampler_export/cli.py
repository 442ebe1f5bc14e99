"""`supersampler export METHOD -o FOLDER`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.errors import ArgumentError
from supersampler_export.folder import write_model_folder
from supersampler_model.method import Method
from supersampler_model.methods import LEARNED, METHODS
from supersampler_model.trained import load_trained

app = typer.Typer(help="Write a method as a model folder for ONNX Runtime.")


@app.command()
def export(
    method: Annotated[
        str,
        typer.Argument(help=f"One of {', '.join([*METHODS, *LEARNED])}; `all`: those without weights."),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write; with `all`, its parent.")],
    weights: Annotated[
        Path | None, typer.Option(help="Of a method that is learned: a weights.safetensors of a run.")
    ] = None,
) -> None:
    """Write METHOD as a model folder: step.onnx (the whole recurrent step), model.json and a model card.

    The files appear only after ONNX Runtime has drawn the pictures that torch draws, at sizes not traced.

    Examples:
      supersampler export taau -o my_taau
      supersampler export classifier --weights run/weights.safetensors -o my_classifier
      supersampler upscale SHOT --model my_taau -o out
    """
    console = Console()
    for name in METHODS if method == "all" else [method]:
        folder = output / name if method == "all" else output
        made = _made(name, weights)
        with console.status(f"exporting {name}"):
            write_model_folder(made, folder)
        console.print(f"{name}: {folder}")


def _made(name: str, weights: Path | None) -> Method:
    if (name in METHODS) == (weights is not None) and name in {*METHODS, *LEARNED}:
        got = "none" if weights is None else weights
        want = f"a file for {', '.join(LEARNED)}, none for the others"
        raise ArgumentError("--weights", got=got, want=want)
    if weights is not None and name in LEARNED:
        return LEARNED[name].of(load_trained(weights))
    if name not in METHODS:
        raise ArgumentError("METHOD", got=name, want=f"one of {', '.join([*METHODS, *LEARNED])}, or all")
    return METHODS[name]()
