"""`supersampler export METHOD -o FOLDER`: a model folder, or with --target shaders for engines.

Torch is only imported for a model folder: --help and shaders work without it.
"""

from pathlib import Path
from typing import Annotated, Literal

import typer

from supersampler.cli.arguments import folder_path
from supersampler.cli.terminal import Terminal
from supersampler.errors import ArgumentError
from supersampler.methods.executors import with_shaders
from supersampler.methods.registry import listed_methods, methods
from supersampler_export.shaders.folder import DESCRIPTION, Images, shader_files, write_shader_folder

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
            metavar="METHOD",
            help=f"One of {listed_methods(methods().values())}; `all`: those that ship. With --target: a "
            "model that ships, or a model folder.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="FOLDER",
            parser=folder_path,
            help="Folder to write; with `all`, its parent.",
        ),
    ],
    weights: Annotated[
        Path | None,
        typer.Option(
            help="Weights of a learned method: weights.safetensors of a run, in place of the released ones."
        ),
    ] = None,
    target: Annotated[
        Literal["wgsl", "npm"] | None,
        typer.Option(
            help="Write compute shaders in place of a model folder: files in WGSL, or a package for npm with "
            "the node for three.js."
        ),
    ] = None,
    images: Annotated[
        Images, typer.Option(help="With --target wgsl: where the shaders take frame and image.")
    ] = "textures",
    aovs: Annotated[
        int, typer.Option(min=0, help="With --target wgsl: channels of AOVs to blend; a texture has four.")
    ] = 0,
) -> None:
    """Write METHOD as a model folder: step.onnx (the whole recurrent step), model.json and a model card.

    The files are written only after ONNX Runtime reproduces the images of torch, at sizes not traced.

    With --target, write a compute shader for each pass, the weights, and upscaler.json, which says how an
    engine runs them. This needs no torch and no GPU.

    \b
    Examples:
      supersampler export taau -o my_taau
      supersampler export classifier --weights run/weights.safetensors -o my_classifier
      supersampler upscale SHOT --model my_taau -o out
      supersampler export classifier --target wgsl -o shaders
      supersampler export all --target npm -o supersampler-npm
    """  # noqa: D301  # \b makes click keep the line breaks
    for option, given, default in (("--aovs", aovs, 0), ("--images", images, "textures")):
        if given != default and target != "wgsl":
            raise ArgumentError(option, got=given, want="none without --target wgsl")
    if target is not None:
        if weights is not None:
            hint = "Export a model folder with these weights, then `supersampler export FOLDER --target ...`."
            raise ArgumentError("--weights", got=weights, want="none with --target", hint=hint)
        names = with_shaders(gbuffers=target != "npm") if method == "all" else [method]
        if target == "npm":
            from supersampler.integrations.web import package_files, write_site

            write_site(output, package_files(names, shader_files))
            Terminal().print(f"{output}: npm install {output.resolve()}", soft_wrap=True)
            return
        for name in names:
            folder = output / name if method == "all" else output
            write_shader_folder(name, folder, images=images, aovs=aovs)
            Terminal().print(f"{name}: {folder / DESCRIPTION}", soft_wrap=True)
        return
    if weights is not None and method == "all":
        raise ArgumentError("--weights", got=weights, want="none with `all`: they are of one method")
    from supersampler_export.folder import write_model_folder
    from supersampler_model.methods import load_method

    console, shipped = Terminal(), [name for name, spec in methods().items() if spec.ships]
    for name in shipped if method == "all" else [method]:
        folder = output / name if method == "all" else output
        made = load_method(name, weights)
        with console.status(f"exporting {name}"):
            write_model_folder(made, folder)
        console.print(f"{name}: {folder}")
