"""A method with precision and skip as text: "classifier", "classifier:fp32", "taau:exact"."""

from dataclasses import dataclass

from supersampler.model import Precision, Skip

_PRECISIONS: dict[str, Precision] = {"fp32": "fp32", "fp16": "fp16", "int8": "int8"}


@dataclass(frozen=True)
class Spec:
    """What `Upscaler` is made with.

    Attributes:
        model: name of a shipped model, or a model folder.
        precision: of what is learned.
        skip: see `Upscaler`.
    """

    model: str
    precision: Precision = "auto"
    skip: Skip = "auto"

    def __str__(self) -> str:
        parts = (self.model, self.precision, self.skip)
        return ":".join(str(part) for part in parts if part != "auto")


def parse_spec(text: str) -> Spec:
    """Parse a setting: a model, then, after colons, a precision, "exact" or a number to skip by.

    A colon may be part of a path: what is none of these belongs to the model.
    """
    precision: Precision = "auto"
    skip: Skip = "auto"
    model = text
    while ":" in model:
        head, _, last = model.rpartition(":")
        if last in _PRECISIONS:
            precision = _PRECISIONS[last]
        elif last == "exact":
            skip = "exact"
        elif _is_number(last):
            skip = float(last)
        else:
            break
        model = head
    return Spec(model, precision, skip)


def _is_number(text: str) -> bool:
    try:
        return 0.0 <= float(text) <= 1.0
    except ValueError:
        return False
