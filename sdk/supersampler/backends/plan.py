"""What a model will need at a size, before any of it is there."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Plan:
    """What an `Upscaler` needs for one render size and one display size.

    Attributes:
        executor: "onnx" or "cpu"; see `Model.load`.
        precision: of what is learned, "fp32", "fp16" or "int8".
        history_bytes: what one frame leaves for the next, twice: one is read while the other is written.
        working_bytes: what a step works in, which Upscalers of one Model share; what they keep to know what
            stands still is counted, too. None for a graph: ONNX Runtime decides.
        multiply_adds: of the learned part, for one frame; 0 where nothing is learned.
    """

    executor: str
    precision: str
    history_bytes: int
    working_bytes: int | None
    multiply_adds: int


def held_bytes(thing: Any) -> int:
    """Bytes of all arrays that an object holds, each once."""
    bases: dict[int, int] = {}
    seen: set[int] = set()
    waiting = [thing]
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            base = item
            while isinstance(base.base, np.ndarray):
                base = base.base  # views share what they look at
            bases[id(base)] = base.nbytes
        elif isinstance(item, dict):
            waiting += item.values()
        elif isinstance(item, (list, tuple)):
            waiting += item
        elif type(item).__module__.startswith("supersampler."):
            waiting += vars(item).values()
    return sum(bases.values())
