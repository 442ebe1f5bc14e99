"""A method with its settings as text: "classifier:fp32", "taau:off", "taau:gpu", "classifier:x2"."""

from dataclasses import dataclass

from supersampler.errors import ArgumentError, shown
from supersampler.model import AtRest, ExecutorName, Precision

_TWO_PASSES = "x2"
_PRECISIONS: dict[str, Precision] = {"fp32": "fp32", "fp16": "fp16", "int8": "int8"}
_AT_REST: dict[str, AtRest] = {"off": "off", "accumulate": "accumulate"}


@dataclass(frozen=True)
class Spec:
    """The arguments of an `Upscaler`.

    Attributes:
        model: name of a shipped model, or a model folder.
        precision: see `Upscaler`.
        at_rest: see `Upscaler`.
        executor: see `Upscaler`.
        passes: see `upscale_sequence`.
    """

    model: str
    precision: Precision = "auto"
    at_rest: AtRest = "converge"
    executor: ExecutorName = "auto"
    passes: int = 1

    def __str__(self) -> str:
        parts = (self.model, self.precision, self.at_rest, self.executor)
        text = ":".join(part for part in parts if part not in ("auto", "converge"))
        return text if self.passes == 1 else f"{text}:{_TWO_PASSES}"


def parse_spec(text: str, *, two_passes: bool = False) -> Spec:
    """Parse a model name, then a precision, "off" or "accumulate" for `at_rest`, "gpu" or "x2", after colons.

    A path may contain colons: whatever follows one and is none of these belongs to the model.

    Raises:
        ArgumentError: "x2" is given, and not `two_passes`, where the caller steps frame by frame.
    """
    precision: Precision = "auto"
    at_rest: AtRest = "converge"
    executor: ExecutorName = "auto"
    passes = 1
    model = text
    while ":" in model:
        head, _, last = model.rpartition(":")
        if last in _PRECISIONS:
            precision = _PRECISIONS[last]
        elif last in _AT_REST:
            at_rest = _AT_REST[last]
        elif last == "gpu":
            executor = "gpu"
        elif last == _TWO_PASSES:
            passes = 2
        else:
            break
        model = head
    if passes == 2 and not two_passes:
        hint = "`bench quality` measures two passes."
        raise ArgumentError("method", got=shown(text), want="a method of one pass", hint=hint)
    return Spec(model, precision, at_rest, executor, passes)
