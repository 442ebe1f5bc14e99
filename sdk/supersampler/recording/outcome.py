"""The outcome of a recorded step: hashes and some pixels of its result, or its error."""

import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32
from supersampler.history import StepResult
from supersampler.io.image_reading import read_exr
from supersampler.io.images import write_exr
from supersampler.io.json_fields import Field
from supersampler.io.shot.frame_files import COLOR, aov_channels, take, take_aovs

SAMPLES = 4096
"""About how many pixels of each image are kept."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result or error of a step.

    Attributes:
        digests: CRC-32 of the bytes of each returned array, by its name in `StepResult`.
        samples: pixels of "image" and "aovs"; see `sampled`.
        error: class name and text of the exception; ("", "") where none was raised.
    """

    digests: Mapping[str, int] = field(default_factory=dict)
    samples: Mapping[str, Array] = field(default_factory=dict)
    error: tuple[str, str] = ("", "")


def returned(index: int, result: StepResult) -> Outcome:
    """Return the outcome of step `index`, which returned `result`."""
    arrays = {name: array for name, array in vars(result).items() if array is not None}
    return Outcome(
        {name: _crc32(array) for name, array in arrays.items()},
        {name: sampled(index, arrays[name]) for name in ("image", "aovs") if name in arrays},
    )


def raised(error: Exception) -> Outcome:
    """Return the outcome of a step that raised `error`."""
    return Outcome(error=(type(error).__name__, str(error)))


def sampled(index: int, image: Float32) -> Float32:
    """Return every s-th pixel in x and y, at an offset that changes with the step.

    Args:
        index: index of the step.
        image: (H, W, k); s is ceil(sqrt(H W / SAMPLES)).
    """
    height, width = image.shape[:2]
    stride = math.ceil(math.sqrt(height * width / SAMPLES))
    top, left = index % min(stride, height), index // stride % min(stride, width)
    return image[top::stride, left::stride]


def outcome_json(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome's line in the log; its pixels are in a separate file."""
    return {"raised": outcome.error} if any(outcome.error) else {"returned": outcome.digests}


def read_outcome(line: Field, samples: Callable[[], Path]) -> Outcome:
    """Read the outcome in a log line; `samples` returns the file of its pixels. ShotError if damaged."""
    if (error := line.optional("raised")) is not None:
        texts = error.texts()
        if len(texts) != 2:
            error.refuse("[class, text]")
        return Outcome(error=(texts[0], texts[1]))
    digests = {name: crc.whole(0, 0xFFFFFFFF) for name, crc in line["returned"].members().items()}
    path = samples()
    channels = read_exr(path)
    aovs = take_aovs(path, channels)
    images = {"image": take(path, channels, COLOR)} | ({} if aovs is None else {"aovs": aovs})
    return Outcome(digests, images)


def write_samples(path: Path, samples: Mapping[str, Array]) -> None:
    """Write the kept pixels of a step's images; ShotError where the disk refuses."""
    image, aovs = samples["image"], samples.get("aovs")
    names = [*COLOR, *aov_channels(0 if aovs is None else aovs.shape[2])]
    pixels = image if aovs is None else np.concatenate([image, aovs], axis=-1)
    write_exr(path, pixels, names, compression="none")


def _crc32(array: NDArray[Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
