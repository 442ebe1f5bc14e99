"""`supersampler info`: prints the properties of a method, a model or a shot."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from supersampler.cli.arguments import open_shot, size_text
from supersampler.cli.terminal import echo
from supersampler.errors import ShotError, did_you_mean

if TYPE_CHECKING:
    from supersampler.io.shot import Shot
    from supersampler.methods.model_info import ModelInfo, TensorInfo
    from supersampler.methods.spec import MethodSpec


def info(
    what: Annotated[
        str | None, typer.Argument(metavar="METHOD|SHOT", help="A method's name, a model folder, or a shot.")
    ] = None,
) -> None:
    """Print a method's inputs and outputs, or a shot's properties; alone, all names and the GPU.

    \b
    Examples:
      supersampler info taau
      supersampler info renders/kitchen
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.backends.gpu.device import adapter_text
    from supersampler.methods.model_file import extrapolation_names, find_model, model_names, read_model_info
    from supersampler.methods.registry import methods

    untrained = {name: spec for name, spec in methods().items() if not spec.ships}
    models, extrapolations = model_names(), extrapolation_names()
    if what is None:
        _print_rows(
            {
                "models": ", ".join(models),
                "extrapolation": ", ".join(extrapolations),
                "without weights": ", ".join(untrained),
                "shots": "plaza",
                "GPU": adapter_text(),
            }
        )
    elif what in [*models, *extrapolations] or (Path(what) / "model.json").is_file():
        _print_rows(_model_rows(read_model_info(find_model(what))))
    elif what in untrained and not Path(what).exists():
        _print_rows(_untrained_rows(untrained[what]))
    elif (Path(what) / "dataset.json").is_file():
        _print_rows(import_module("supersampler_model.data.dataset.overview").rows(Path(what)))
    else:
        _print_rows(_shot_rows(_opened(what)))


def _opened(what: str) -> "Shot":
    """Open a shot; where it is missing, suggest names of methods, too."""
    from supersampler.methods.registry import methods

    try:
        return open_shot(what)
    except ShotError as error:
        hint = did_you_mean(what, methods())
        raise ShotError(error.path, error.problem, hint or error.hint) from None


def _print_rows(rows: dict[str, str]) -> None:
    width = max(map(len, rows))
    for name, value in rows.items():
        for number, line in enumerate(value.split("\n")):
            echo(f"{name if number == 0 else '':{width}}  {line}".rstrip())


def _ratio_text(ratios: tuple[float, float]) -> str:
    text = f"only {ratios[0]}" if ratios[0] == ratios[1] else f"{ratios[0]} to {ratios[1]}"
    return f"{text} (display over render size, each axis)"


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


def _model_rows(model: "ModelInfo") -> dict[str, str]:
    from supersampler.methods.gbuffers import listed

    ratios = _ratio_text(model.ratios)
    if model.extrapolates:
        ratios = "none: it computes the colour of frames that were not shaded, at render size"
    extrapolated = {"extrapolated frames": "no others"} if model.only_extrapolated else {}
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
        "history": "\n".join(_tensor_text(item.input) for item in model.history) or "none",
        "image": _tensor_text(model.image),
        "settings": ", ".join(map(_fact, model.config.items())) or "none",
        "agreement": ", ".join(map(_fact, model.parity.items())),
        "files": "\n".join(f"{name}  sha256 {digest}" for name, digest in model.files.items()),
        "licence": model.licence,
        "attribution": "\n".join(model.attributions) or "none",
        "made with": ", ".join(map(_fact, model.versions.items())),
    }


def _fact(item: tuple[str, object]) -> str:
    name, value = item
    return f"{len(value)} {name}" if isinstance(value, list) else f"{name} {value}"


def _tensor_text(tensor: "TensorInfo") -> str:
    return f"{tensor.name}  {tensor.type} ({', '.join(map(str, tensor.shape))})"


def _shot_rows(shot: "Shot") -> dict[str, str]:
    from supersampler.methods.gbuffers import listed, names_of

    frame = shot.read(0).frame
    return {
        "shot": shot.name,
        "folder": str(shot.path),
        "frames": f"{len(shot)}" + (f" at {shot.frame_rate:g} a second" if shot.frame_rate else ""),
        "render size": size_text(shot.render_size),
        "display size": size_text(shot.display_size),
        "references": f"{len(shot.reference_indices)} frames",
        "conventions": repr(shot.conventions),
        "G-buffers": listed(names_of(frame)),
        "AOVs": "none" if frame.aovs is None else f"{frame.aovs.shape[2]} channels",
        "licence": shot.license or "not stated",
        "attribution": "\n".join(shot.attribution) or "none",
    }
