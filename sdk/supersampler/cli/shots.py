"""`supersampler info`, `check` and `import`: commands on shots and models."""

import json
import shlex
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from supersampler.cli import arguments
from supersampler.cli.arguments import SourceOptions, open_with, size_text, source_notes, with_option_groups
from supersampler.cli.terminal import Terminal, echo
from supersampler.errors import ShotError, SupersamplerError, did_you_mean

if TYPE_CHECKING:
    from supersampler.io.shot import Shot
    from supersampler.methods.model_info import ModelInfo, TensorInfo
    from supersampler.methods.spec import MethodSpec


def info(
    name: Annotated[
        str | None, typer.Argument(metavar="METHOD|SHOT", help="A method's name, a model folder, or a shot.")
    ] = None,
    providers: Annotated[
        bool, typer.Option("--providers", help="Print which providers of ONNX Runtime run a method's nodes.")
    ] = False,
    layer: arguments.ViewLayerOption = None,
    channels: arguments.ChannelsOption = None,
    conventions: arguments.ConventionsOption = None,
    follow_links: arguments.FollowLinksOption = None,
) -> None:
    """Print a method's inputs and outputs, or a shot's properties; without argument, all names and the GPU.

    --providers loads the method's graph with each installed provider, and lists the nodes that a GPU provider
    leaves to the CPU, by operator. Each of them costs a copy between CPU and GPU.

    \b
    Examples:
      supersampler info taau
      supersampler info classifier --providers
      supersampler info renders/kitchen
      supersampler info "out/beauty.####.exr" --conventions unreal
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.backends.gpu.device import adapter_text
    from supersampler.methods.model_file import extrapolation_names, find_model, model_names, read_model_info
    from supersampler.methods.registry import methods

    untrained = {key: spec for key, spec in methods().items() if not spec.ships}
    models, extrapolations = model_names(), extrapolation_names()
    if name is None:
        rows = {
            "models": ", ".join(models),
            "extrapolation": ", ".join(extrapolations),
            "without weights": ", ".join(untrained),
            "shots": "plaza",
            "GPU": adapter_text(),
        }
    elif name in [*models, *extrapolations] or (Path(name) / "model.json").is_file():
        model = read_model_info(find_model(name))
        rows = _provider_rows(model) if providers else _model_rows(model)
    elif name in untrained and not Path(name).exists():
        rows = _untrained_rows(untrained[name])
    elif (Path(name) / "dataset.json").is_file():
        rows = import_module("supersampler_model.data.dataset.overview").rows(Path(name))
    else:
        try:
            source = SourceOptions(
                layer=layer, channels=channels, conventions=conventions, follow_links=follow_links
            )
            rows = _shot_rows(open_with(name, source))
        except ShotError as error:
            hint = did_you_mean(name, methods())
            raise ShotError(error.path, error.problem, hint or error.hint) from None
    width = max(map(len, rows))
    for label, value in rows.items():
        for number, line in enumerate(value.split("\n")):
            echo(f"{label if number == 0 else '':{width}}  {line}".rstrip())


@with_option_groups
def check(
    *,
    shot: Annotated[str, typer.Argument(metavar="SHOT", help="A shot, or the name of a shipped one.")],
    source: SourceOptions,
    frames: Annotated[int, typer.Option(min=2, help="Number of frames to read from the middle.")] = 6,
) -> None:
    """Detect the conventions of SHOT: motion, jitter and depth.

    Tries all units, directions and flips of motion, and all units, signs and flips of jitter, on a few
    frames. Ranks them by how well they reproject each image to the next. Prints the best ones, their margins,
    the Conventions to write, also as an option, and the G-buffers of the first frame. The exit code is 1 if
    the detected conventions differ from the stated ones, or if the frames have another mistake.

    \b
    Examples:
      supersampler check shots/kitchen
      supersampler check "out/beauty.####.exr" --conventions unreal --jitter jitter.json
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.methods.gbuffers import gbuffer_arrays, listed
    from supersampler.validation import detect_conventions

    opened = open_with(shot, source)
    detection = detect_conventions(opened, frames=frames)
    echo(f"{opened.name}: {min(frames, len(opened))} of {len(opened)} frames")
    echo(f"G-buffers: {listed(gbuffer_arrays(opened.read_raw(0)))}")
    for line in (*source_notes(opened), *detection.summary().splitlines()):
        echo(line)
    if detection.conventions != detection.stated:
        fields = json.dumps(detection.conventions.to_json())
        option = f"--conventions {'supersampler' if fields == '{}' else shlex.quote(fields)}"
        echo(f'In shot.json: "conventions": {fields}' if opened.own_format else option)
    if not detection.agrees:
        raise typer.Exit(1)


@with_option_groups
def import_shot(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE", help="Folder of frames, pattern such as beauty.####.exr, or .safetensors."
        ),
    ],
    output: arguments.OutputOption,
    options: SourceOptions,
) -> None:
    """Copy frames of other programs into a shot of this package's format.

    Pixels are not converted: the shot states their conventions, which `supersampler check` tests. --channels
    describes motion and depth that are packed into 8-bit channels (docs/shots.md). The same command resumes a
    stopped run.

    \b
    Examples:
      supersampler import renders/kitchen -o shots/kitchen --jitter jitter.json
      supersampler import "out/beauty.####.exr" -o shots/city --conventions unreal
      supersampler import unreal_out -o shots/city --channels map.json --conventions unreal
      supersampler import village_png -o shots/village --channels packed.json --conventions uv.json
      supersampler import 0001.safetensors -o shots/arm
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.io.shot import copy_shot

    shot = open_with(source, options)
    with Terminal(stderr=True).status(f"copying {len(shot)} frames"):
        written = copy_shot(shot, output, resume=True)
    echo(f"{len(written)} frames of {size_text(written.render_size)} in {output}")
    for note in source_notes(shot):
        echo(note)
    echo(f"Next: supersampler check {output}")


def _untrained_rows(method: "MethodSpec") -> dict[str, str]:
    from supersampler.methods.gbuffers import GBUFFERS, listed

    train = f"`supersampler train {method.name}`"
    export = f"`supersampler export {method.name} --weights FILE -o FOLDER`"
    return {
        "method": method.name,
        "source": method.source,
        "ratios": _ratio_text(method.ratios),
        "G-buffers": listed([name for name in method.inputs if name in GBUFFERS]),
        "weights": f"none ship\ntrain it: {train}\nand export it: {export}",
    }


def _provider_rows(model: "ModelInfo") -> dict[str, str]:
    from supersampler.backends.onnx.runtime import NAMES, ort
    from supersampler.backends.onnx.session import node_placement

    rows, installed = {}, ort.get_available_providers()
    for name in (name for name, provider in NAMES.items() if provider in installed):
        try:
            placed = node_placement(model.steps["fp32"], NAMES[name])
        except SupersamplerError as error:
            rows[name] = f"does not load it: {error}"
            continue
        lines = [f"{counts.total()} nodes by {provider}" for provider, counts in placed.items()]
        left = placed.get(NAMES["cpu"]) if name != "cpu" else None
        if left:
            lines.append(
                "by the CPU: " + ", ".join(f"{kind} {number}" for kind, number in left.most_common())
            )
        rows[name] = "\n".join(lines)
    return rows


def _model_rows(model: "ModelInfo") -> dict[str, str]:
    from supersampler.methods.gbuffers import listed

    ratios = _ratio_text(model.ratios)
    if model.extrapolates:
        ratios = "none: computes the colour of unshaded frames, at render size"
    extrapolated = {"extrapolated frames": "only"} if model.only_extrapolated else {}
    if model.extrapolated is not None:
        extrapolated = {"extrapolated frames": f"by the model in {model.extrapolated.name}"}
    return {
        "method": model.method,
        "source": model.source,
        "folder": str(model.folder),
        "contract": str(model.contract),
        "ratios": ratios,
        **extrapolated,
        "inputs": "\n".join(map(_tensor_text, model.inputs)),
        "G-buffers": listed(model.gbuffers),
        "history": "\n".join(map(_tensor_text, model.history)) or "none",
        "image": _tensor_text(model.image),
        "settings": ", ".join(map(_fact, model.config.items())) or "none",
        "agreement": ", ".join(map(_fact, model.parity.items())),
        "files": "\n".join(f"{name}  sha256 {digest}" for name, digest in model.files.items()),
        "licence": model.licence,
        "attribution": "\n".join(model.attributions) or "none",
        "made with": ", ".join(map(_fact, model.versions.items())),
    }


def _shot_rows(shot: "Shot") -> dict[str, str]:
    from supersampler.methods.gbuffers import gbuffer_arrays, listed

    frame = shot.read(0).frame
    return {
        "shot": shot.name,
        "folder": str(shot.path),
        "frames": f"{len(shot)}" + (f" at {shot.frame_rate:g} a second" if shot.frame_rate else ""),
        "render size": size_text(shot.render_size),
        "display size": size_text(shot.display_size),
        "references": f"{len(shot.reference_indices)} frames",
        "conventions": repr(shot.conventions),
        "G-buffers": listed(gbuffer_arrays(frame)),
        "AOVs": "none" if frame.aovs is None else f"{frame.aovs.shape[2]} channels",
        "licence": shot.info.license or "not stated",
        "attribution": "\n".join(shot.info.attribution) or "none",
    }


def _ratio_text(ratios: tuple[float, float]) -> str:
    text = f"only {ratios[0]}" if ratios[0] == ratios[1] else f"{ratios[0]} to {ratios[1]}"
    return f"{text} (display over render size, each axis)"


def _tensor_text(tensor: "TensorInfo") -> str:
    return f"{tensor.name}  {tensor.type} ({', '.join(map(str, tensor.shape))})"


def _fact(item: tuple[str, object]) -> str:
    name, value = item
    return f"{len(value)} {name}" if isinstance(value, list) else f"{name} {value}"
