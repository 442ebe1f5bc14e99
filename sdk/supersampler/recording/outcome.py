"""What came of a step, in little room: enough to say whether another is the same, and how far it is off."""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32
from supersampler.history import StepResult
from supersampler.recording.format import Record, octets
from supersampler.recording.values import members, texts, whole

SAMPLES = 4096
"""Pixels of each image that are kept, about: little beside a frame."""

_SAMPLED = ("image", "aovs")  # maps tell why a picture is as it is, and may differ where it does not


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a step returned, or raised.

    Attributes:
        digests: CRC-32 of each array that was returned, by its name in `StepResult`.
        samples: pixels of the image and of what was carried; see `sampled`.
        error: name of the exception's class and its text; "" and "" where none was raised.
    """

    digests: Mapping[str, int] = field(default_factory=dict)
    samples: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    error: tuple[str, str] = ("", "")


def returned(index: int, result: StepResult) -> Outcome:
    """Outcome of the step of this index that returned `result`."""
    arrays = {f.name: getattr(result, f.name) for f in fields(result)}
    there = {name: array for name, array in arrays.items() if array is not None}
    return Outcome(
        {name: zlib.crc32(octets(array)) for name, array in there.items()},
        {name: sampled(index, there[name]) for name in _SAMPLED if name in there},
    )


def raised(error: Exception) -> Outcome:
    """Outcome of a step that raised `error`."""
    return Outcome(error=(type(error).__name__, str(error)))


def sampled(index: int, image: Float32) -> Float32:
    """Every so-many-th pixel in x and y, from a place that moves on from step to step.

    Args:
        index: of the step.
        image: (H, W, k); small ones are returned whole.
    """
    height, width = image.shape[:2]
    stride = math.ceil(math.sqrt(height * width / SAMPLES))
    top, left = index % min(stride, height), index // stride % min(stride, width)
    return image[top::stride, left::stride]


def outcome_record(outcome: Outcome) -> Record:
    """As it is written after its step."""
    return Record("outcome", {"digests": outcome.digests, "error": outcome.error}, outcome.samples)


def outcome_of(record: Record) -> Outcome:
    """Undo `outcome_record`.

    Raises:
        KeyError, ValueError: it is no outcome.
    """
    digests = {name: whole(n, 0, 0xFFFFFFFF) for name, n in members(record.values["digests"]).items()}
    kind, error = texts(record.values["error"], 2)
    samples = {name: checked_image(name, image) for name, image in record.arrays.items()}
    return Outcome(digests, samples, (kind, error))


def checked_image(name: str, image: NDArray[Any]) -> Float32:
    """Return an array of a record that is to be an image.

    Raises:
        ValueError: it is none.
    """
    if image.dtype != np.float32 or image.ndim != 3 or image.size == 0:
        raise ValueError(f"{name} is {image.shape} {image.dtype}; want (H, W, k) float32")
    return image
