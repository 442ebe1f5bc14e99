"""A method with precision, skip and backend as text: "classifier:fp32", "taau:exact", "taau:gpu"."""

from contextlib import suppress
from dataclasses import dataclass

from supersampler.model import ExecutorName, Precision, Skip

_PRECISIONS: dict[str, Precision] = {"fp32": "fp32", "fp16": "fp16", "int8": "int8"}


@dataclass(frozen=True)
class Spec:
    """The arguments of an `Upscaler`.

    Attributes:
        model: name of a shipped model, or a model folder.
        precision: see `Upscaler`.
        skip: see `Upscaler`.
        executor: see `Upscaler`.
    """

    model: str
    precision: Precision = "auto"
    skip: Skip = "auto"
    executor: ExecutorName = "auto"

    def __str__(self) -> str:
        parts = (self.model, self.precision, self.skip, self.executor)
        return ":".join(str(part) for part in parts if part != "auto")


def parse_spec(text: str) -> Spec:
    """Parse a model name, followed by a precision, "exact", a skip tolerance or "gpu", each after a colon.

    A path may contain colons: whatever follows one and is none of these belongs to the model.
    """
    precision: Precision = "auto"
    skip: Skip = "auto"
    executor: ExecutorName = "auto"
    model = text
    while ":" in model:
        head, _, last = model.rpartition(":")
        if last in _PRECISIONS:
            precision = _PRECISIONS[last]
        elif last == "exact":
            skip = "exact"
        elif last == "gpu":
            executor = "gpu"
        elif _is_tolerance(last):
            skip = float(last)
        else:
            break
        model = head
    return Spec(model, precision, skip, executor)


def _is_tolerance(text: str) -> bool:
    with suppress(ValueError):
        return 0.0 <= float(text) <= 1.0
    return False
