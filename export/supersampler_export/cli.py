"""`supersampler export METHOD -o FOLDER`: a model folder, or with --target shaders for engines.

Torch is imported where it is used: --help and shaders work without.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from supersampler.cli.terminal import Terminal
from supersampler.errors import ArgumentError, did_you_mean
from supersampler.methods.catalog import FIXED, LEARNED, listed_methods
from supersampler_export.shaders.folder import (
    DESCRIPTION,
    Images,
    models_with_shaders,
    write_shader_folder,
)
from supersampler_export.shaders.translation import Target

if TYPE_CHECKING:
    from supersampler_model.methods.base import Method

app = typer.Typer(
    help="Write a method as a model folder for ONNX Runtime, or its shaders for engines.",
    add_completion=False,
    rich_markup_mode=None,
)


@app.command()
def export(
    method: Annotated[
        str,
        typer.Argument(
            help=f"One of {listed_methods((*FIXED, *LEARNED))}; `all`: those that ship. With --target: a "
            "model that ships, or a model folder."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write; with `all`, its parent.")],
    weights: Annotated[
        Path | None,
        typer.Option(
            help="Weights of a learned method: weights.safetensors of a run, in place of the released ones."
        ),
    ] = None,
    target: Annotated[
        Target | None,
        typer.Option(help="Write compute shaders in this language in place of a model folder."),
    ] = None,
    images: Annotated[
        Images, typer.Option(help="With --target: where the shaders take frame and image.")
    ] = "textures",
) -> None:
    """Write METHOD as a model folder: step.onnx (the whole recurrent step), model.json and a model card.

    The files are written only after ONNX Runtime reproduces the images of torch, at sizes not traced.

    With --target, write a compute shader for each pass, the weights, and upscaler.json, which says how an
    engine runs them. This needs no torch and no GPU; all but wgsl are translated by naga, which npm installs.

    \b
    Examples:
      supersampler export taau -o my_taau
      supersampler export classifier --weights run/weights.safetensors -o my_classifier
      supersampler upscale SHOT --model my_taau -o out
      supersampler export classifier --target wgsl -o shaders
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    if target is not None:
        if weights is not None:
            hint = "Export a model folder with these weights, then `supersampler export FOLDER --target ...`."
            raise ArgumentError("--weights", got=weights, want="none with --target", hint=hint)
        for name in models_with_shaders() if method == "all" else [method]:
            folder = output / name if method == "all" else output
            write_shader_folder(name, folder, target=target, images=images)
            Terminal().print(f"{name}: {folder / DESCRIPTION}", soft_wrap=True)
        return
    if images != "textures":
        raise ArgumentError("--images", got=images, want="none without --target")
    from supersampler_export.folder import write_model_folder

    console = Terminal()
    for name in shipped_methods() if method == "all" else [method]:
        folder = output / name if method == "all" else output
        made = load_method(name, weights)
        with console.status(f"exporting {name}"):
            write_model_folder(made, folder)
        console.print(f"{name}: {folder}")


def shipped_methods() -> list[str]:
    """Return the names of the shipped methods: those without weights, and those whose weights ship."""
    from supersampler_model.methods.weights_file import shipped_weights

    return [*FIXED, *(name for name in LEARNED if shipped_weights(name).exists())]


def load_method(name: str, weights: Path | None = None) -> "Method":
    """Return a method, with the weights of a file, or with those that ship.

    Raises:
        ArgumentError: there is no such method, or it has no weights.
    """
    from supersampler_model.methods import LEARNED, METHODS
    from supersampler_model.methods.weights_file import load_trained, shipped_weights

    known = (*METHODS, *LEARNED)
    if name not in known:
        want, hint = f"one of {', '.join(known)}, or all", did_you_mean(name, known)
        raise ArgumentError("METHOD", got=name, want=want, hint=hint)
    if name in LEARNED and (weights is not None or shipped_weights(name).exists()):
        return LEARNED[name].of(load_trained(weights or shipped_weights(name)))
    if name in METHODS and weights is None:
        return METHODS[name]()
    want = "none, as nothing in it is learned" if name in METHODS else "a file, as none ship"
    raise ArgumentError("--weights", got=weights, want=want)
