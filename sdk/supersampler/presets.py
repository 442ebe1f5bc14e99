"""Presets: settings on the Pareto frontier of run time and error (docs/pareto.md)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from supersampler.arguments import as_flag, as_index, checked_choice
from supersampler.errors import ArgumentError
from supersampler.model import ExecutorName, Model, Precision

PresetName = Literal["fast", "balanced", "high"]


class Preset(NamedTuple):
    """Arguments of `Upscaler` that a preset sets."""

    model: str
    precision: Precision


PRESETS: Mapping[PresetName, Preset] = {
    "fast": Preset("taau", "auto"),
    "balanced": Preset("classifier-small", "auto"),
    "high": Preset("classifier", "auto"),
}
"""As `supersampler bench pareto` chooses them."""


def chosen(
    preset: PresetName | None, model: Model | str | Path | None, precision: Precision
) -> tuple[Model | str | Path, Precision]:
    """Return model and precision: those given, or those of a preset.

    Raises:
        ArgumentError: a value is unknown, or a preset is given together with a value that it sets.
    """
    precision = checked_choice("precision", precision, get_args(Precision))
    if preset is None:
        return "classifier" if model is None else model, precision
    checked_choice("preset", preset, get_args(PresetName))
    if model is not None or precision != "auto":
        got = f"{preset!r} beside a model or a precision"
        raise ArgumentError("preset", got=got, want="it alone, which sets them, or these alone")
    return PRESETS[preset]


def loaded_model(
    model: Model | str | Path,
    providers: str | Sequence[str],
    threads: int,
    executor: ExecutorName,
    precision: Precision,
    *,
    capture: bool,
) -> Model:
    """Return a `Model` unchanged, or load one; see `Model.load` for the arguments.

    Raises:
        ArgumentError: arguments of `Model.load` are given together with a `Model`.
        ModelError, ProviderError, ArgumentError: see `Model.load`.
    """
    if not isinstance(model, Model):
        options: dict[str, Any] = {"providers": providers, "threads": threads, "executor": executor}
        return Model.load(model, **options, precision=precision, capture=capture)
    words = {"providers": providers, "executor": executor, "precision": precision}
    set_again = [name for name, word in words.items() if not (isinstance(word, str) and word == "auto")]
    set_again += ["threads"] * (as_index(threads) != 0) + ["capture"] * (as_flag(capture) is not False)
    if set_again:
        raise ArgumentError(" and ".join(set_again), got="set beside a Model", want="set in Model.load")
    return model
