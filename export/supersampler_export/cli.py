"""`supersampler export METHOD -o FOLDER`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.errors import ArgumentError
from supersampler_export.folder import write_model_folder
from supersampler_model.methods import METHODS

app = typer.Typer(help="Write a method as a model folder for ONNX Runtime.")


@app.command()
def export(
    method: Annotated[str, typer.Argument(help=f"One of {', '.join(METHODS)}, or `all`.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write; with `all`, its parent.")],
) -> None:
    """Write METHOD as a model folder: step.onnx (the whole recurrent step), model.json and a model card.

    The files appear only after ONNX Runtime has drawn the pictures that torch draws, at sizes not traced.

    Examples:
      supersampler export taau -o my_taau
      supersampler upscale SHOT --model my_taau -o out
    """
    names = list(METHODS) if method == "all" else [method]
    console = Console()
    for name in names:
        if name not in METHODS:
            raise ArgumentError("METHOD", got=name, want=f"one of {', '.join(METHODS)}, or all")
        folder = output / name if method == "all" else output
        with console.status(f"exporting {name}"):
            write_model_folder(METHODS[name](), folder)
        console.print(f"{name}: {folder}")
