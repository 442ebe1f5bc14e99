"""`Plan`: the memory and arithmetic that a model needs at a size."""

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Plan:
    """Memory and arithmetic of an `Upscaler` for one render size and one display size.

    Attributes:
        executor: "onnx" or "cpu"; see `Model.load`.
        precision: precision of the network: "fp32", "fp16" or "int8".
        history_bytes: bytes of two histories: a step reads one and writes the other.
        working_bytes: bytes of the buffers of a step, which Upscalers of one Model share. None with the ONNX
            backend, where ONNX Runtime allocates them.
        multiply_adds: multiply-adds of the network per frame; 0 without a network.
    """

    executor: str
    precision: str
    history_bytes: int
    working_bytes: int | None
    multiply_adds: int


def held_bytes(thing: Any) -> int:
    """Return the bytes of all arrays that an object refers to; shared memory counts once."""
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
            while isinstance(base.base, np.ndarray):  # a view
                base = base.base
            bases[id(base)] = base.nbytes
        elif isinstance(item, dict):
            waiting += item.values()
        elif isinstance(item, (list, tuple)):
            waiting += item
        elif type(item).__module__.startswith("supersampler."):
            waiting += vars(item).values()
    return sum(bases.values())
