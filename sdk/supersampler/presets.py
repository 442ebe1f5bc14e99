"""Presets: settings that lead in run time against error, by the rule of docs/pareto.md."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from supersampler.checked import checked_choice
from supersampler.errors import ArgumentError
from supersampler.model import Model, Precision, Skip
from supersampler.skip import checked_skip

PresetName = Literal["fast", "balanced", "high"]


class Preset(NamedTuple):
    """What an Upscaler is made with; see there."""

    model: str
    precision: Precision
    skip: Skip


PRESETS: Mapping[PresetName, Preset] = {
    "fast": Preset("taau", "auto", "auto"),
    "balanced": Preset("classifier-small", "auto", "auto"),
    "high": Preset("classifier", "auto", "exact"),
}
"""`supersampler bench pareto` chooses them."""


def chosen(
    preset: PresetName | None, model: Model | str | Path | None, precision: Precision, skip: Skip
) -> tuple[Model | str | Path, Precision, Skip]:
    """Return model, precision and skipping: those given, or those of a preset.

    Raises:
        ArgumentError: there is no such preset, precision or skip, or something that a preset sets is given
            beside it.
    """
    precision = checked_choice("precision", precision, get_args(Precision))
    skip = checked_skip(skip)
    if preset is None:
        return "classifier" if model is None else model, precision, skip
    checked_choice("preset", preset, get_args(PresetName))
    if model is not None or (precision, skip) != ("auto", "auto"):
        got = f"{preset!r} beside a model, a precision or skip"
        raise ArgumentError("preset", got=got, want="it alone, which sets them, or these alone")
    return PRESETS[preset]
