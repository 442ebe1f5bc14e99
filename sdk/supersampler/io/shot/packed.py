"""Numbers that are packed into the bytes of 8-bit channels, such as motion vectors in RGBA8."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from supersampler.arguments import as_number
from supersampler.errors import ArgumentError, did_you_mean, shown
from supersampler.frame import Array, Float32

_MOST_BYTES = 4
_SAME_CODE = 0.01  # of a step: ranges in JSON are rounded
_BASES = (256, 255)
_KEYS = ("bytes", "range", "base")


@dataclass(frozen=True, slots=True)
class Packing:
    """The code of numbers in bytes: a number grows linearly with the weighted sum of its bytes.

    Attributes:
        bytes_each: bytes of a number, 1 to 4, the most significant one first.
        low: number whose bytes are all 0.
        high: number whose bytes are all 255; less than `low` where the code runs backwards.
        base: weight of a byte over that of the next one: 256, or 255 as in Unity's EncodeFloatRG.
    """

    bytes_each: int
    low: float
    high: float
    base: int = 256

    @property
    def step(self) -> float:
        """Difference of two successive numbers, > 0."""
        return abs(self.high - self.low) / (255.0 * float(self._weights().sum()))

    @property
    def smallest(self) -> float:
        """Magnitude of the number nearest to 0; exactly 0 where a code means it."""
        if self.low * self.high > 0.0:
            return min(abs(self.low), abs(self.high))
        codes = abs(self.low) / self.step
        off = abs(codes - round(codes))
        return 0.0 if off < _SAME_CODE else off * self.step

    def decoded(self, channels: Array) -> Float32:
        """Return the numbers, (h, w) of one and (h, w, n) of n.

        Args:
            channels: (h, w) or (h, w, n * bytes_each), byte / 255, those of a number beside each other.
        """
        height, width = channels.shape[:2]
        levels = np.rint(channels.astype(np.float64) * 255.0).reshape(height, width, -1, self.bytes_each)
        weights = self._weights()
        numbers = self.low + (levels @ weights) * ((self.high - self.low) / (255.0 * weights.sum()))
        single: Float32 = numbers.astype(np.float32)
        return single[..., 0] if single.shape[2] == 1 else single

    def _weights(self) -> Array:
        return np.float64(self.base) ** np.arange(self.bytes_each - 1, -1, -1)


def parse_packing(name: str, value: Mapping[str, Any], count: int) -> tuple[list[str], Packing]:
    """Return the channels of a packed array, in the order of `Packing.decoded`, and its packing.

    Args:
        name: of the array, for messages.
        value: {"bytes": ..., "range": [low, high], "base": 256}. "bytes" lists the channels of a number, the
            most significant byte first; of an array of several numbers, one such list each.
        count: numbers a pixel.

    Raises:
        ArgumentError: a key is missing or unknown, or a value is not of this form.
    """
    place = f"channel_map[{name!r}]"
    for key in value:
        if key not in _KEYS:
            got, hint = f"with {shown(key)}", did_you_mean(key, _KEYS)
            raise ArgumentError(place, got=got, want=f"keys of {', '.join(_KEYS)}", hint=hint)
    listed = [value.get("bytes")] if count == 1 else value.get("bytes")
    lists = listed if isinstance(listed, list | tuple) else []
    sizes = {len(each) if _are_texts(each) else 0 for each in lists}
    if len(lists) != count or len(sizes) != 1 or not 1 <= min(sizes) <= _MOST_BYTES:
        one = f"a list of 1 to {_MOST_BYTES} channels, the most significant byte first"
        want = one if count == 1 else f"{count} lists of equal length, for each number {one}"
        raise ArgumentError(f"{place}['bytes']", got=shown(value.get("bytes")), want=want)
    low, high = _range(f"{place}['range']", value.get("range"))
    base = value.get("base", _BASES[0])
    if base not in _BASES:
        want = "256, or 255 as in Unity's EncodeFloatRG"
        raise ArgumentError(f"{place}['base']", got=shown(base), want=want)
    return [channel for each in lists for channel in each], Packing(min(sizes), low, high, int(base))


def losses_of(
    *,
    color_bits: int | None,
    motion: Packing | None,
    pixels_per_unit: tuple[float, float],
    depth: Packing | None,
    is_jittered: bool,
) -> tuple[str, ...]:
    """Return sentences on what integers in the files do not hold; none where no integers are read.

    Args:
        color_bits: of each channel of the colour; None where it is floating point.
        motion: packing of the motion; None where it is floating point.
        pixels_per_unit: (x, y) of the motion's unit, either sign.
        depth: packing of the depth; None where it is floating point.
        is_jittered: whether any frame has a jitter.
    """
    losses = []
    if color_bits is not None:
        losses.append(f"Colour has {color_bits} bits and ends at white: highlights are cut off.")
    if motion is not None:
        x, y = (abs(factor) for factor in pixels_per_unit)
        text = f"Motion comes in steps of {x * motion.step:.2g} x {y * motion.step:.2g} render pixels"
        if motion.smallest:
            rest = f"{x * motion.smallest:.2g} x {y * motion.smallest:.2g}"
            text += f", and none is 0: what is at rest moves by {rest} a frame"
        losses.append(f"{text}.")
    if depth is not None:
        losses.append(f"Depth comes in {round(abs(depth.high - depth.low) / depth.step) + 1} steps.")
    if losses and not is_jittered:
        losses.append("No frame has jitter: what is at rest gains no detail from frame to frame.")
    return tuple(losses)


def _are_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(text, str) for text in value)


def _range(place: str, value: object) -> tuple[float, float]:
    listed = value if isinstance(value, list | tuple) else ()
    numbers = [number for each in listed if (number := as_number(each)) is not None and np.isfinite(number)]
    if len(numbers) == len(listed) == 2 and numbers[0] != numbers[1]:
        return numbers[0], numbers[1]
    want = "[low, high], two different finite numbers: those of bytes that are all 0 and all 255"
    raise ArgumentError(place, got=shown(value), want=want, hint="Motion in UV often has [-1, 1].")
