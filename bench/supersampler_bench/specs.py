"""A method with its settings as text: "classifier:fp32", "taau:exact", "taau:gpu", "classifier:x2"."""

from contextlib import suppress
from dataclasses import dataclass

from supersampler.errors import ArgumentError, shown
from supersampler.model import ExecutorName, Precision, Skip

_TWO_PASSES = "x2"
_PRECISIONS: dict[str, Precision] = {"fp32": "fp32", "fp16": "fp16", "int8": "int8"}


@dataclass(frozen=True)
class Spec:
    """The arguments of an `Upscaler`.

    Attributes:
        model: name of a shipped model, or a model folder.
        precision: see `Upscaler`.
        skip: see `Upscaler`.
        executor: see `Upscaler`.
        passes: see `upscale_sequence`.
    """

    model: str
    precision: Precision = "auto"
    skip: Skip = "auto"
    executor: ExecutorName = "auto"
    passes: int = 1

    def __str__(self) -> str:
        parts = (self.model, self.precision, self.skip, self.executor)
        text = ":".join(str(part) for part in parts if part != "auto")
        return text if self.passes == 1 else f"{text}:{_TWO_PASSES}"


def parse_spec(text: str, *, two_passes: bool = False) -> Spec:
    """Parse a model name, then a precision, "exact", a skip tolerance, "gpu" or "x2", each after a colon.

    A path may contain colons: whatever follows one and is none of these belongs to the model.

    Raises:
        ArgumentError: "x2" is given, and not `two_passes`, where the caller steps frame by frame.
    """
    precision: Precision = "auto"
    skip: Skip = "auto"
    executor: ExecutorName = "auto"
    passes = 1
    model = text
    while ":" in model:
        head, _, last = model.rpartition(":")
        if last in _PRECISIONS:
            precision = _PRECISIONS[last]
        elif last == "exact":
            skip = "exact"
        elif last == "gpu":
            executor = "gpu"
        elif last == _TWO_PASSES:
            passes = 2
        elif _is_tolerance(last):
            skip = float(last)
        else:
            break
        model = head
    if passes == 2 and not two_passes:
        hint = "`bench quality` measures two passes."
        raise ArgumentError("method", got=shown(text), want="a method of one pass", hint=hint)
    return Spec(model, precision, skip, executor, passes)


def _is_tolerance(text: str) -> bool:
    with suppress(ValueError):
        return 0.0 <= float(text) <= 1.0
    return False
