"""Render sizes, jitter sequences, jittered projections and mip bias for temporal upscaling.

Sizes are (width, height). Jitter is (x right, y down) in render pixels: the sample is taken at the pixel's
centre + jitter. FSR and XeSS use the opposite sign (centre - jitter): see `Conventions.fsr`.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from supersampler.arguments import MAX_SIDE, as_index, as_number, checked_choice, checked_size, is_row
from supersampler.errors import ArgumentError, FrameError, shown
from supersampler.frame import Size


def check_ratio(ratios: tuple[float, float], render_size: Size, display_size: Size) -> None:
    """Raise FrameError unless a method with these ratios (min, max) upscales between the sizes.

    A range allows for the rounding of both sizes to whole pixels, but for no frame larger than the display,
    as vectors of the CPU backend have a lane for each pixel. A method with a single ratio computes a
    whole block of display pixels for each render pixel, and needs exactly that multiple of the render size.
    """
    low, high = ratios
    if low == high:
        display = scaled(render_size, low)
        if display == display_size:
            return
        frames = scaled(display_size, 1.0 / low)
        possible = [f"frames of {frames}"] * (frames is not None)
        possible += [f"a display of {display}"] * (display is not None)
        raise FrameError(
            "size",
            got=f"{render_size}, for a display of {display_size}",
            want=f"{' or '.join(possible) or 'other sizes'}: this method upscales exactly {low:g} times",
            hint="Sizes are (width, height).",
        )
    for axis, name in enumerate(("width", "height")):
        ratio = display_size[axis] / render_size[axis]
        smallest = (display_size[axis] - 1) / (render_size[axis] + 1)
        largest = (display_size[axis] + 1) / max(render_size[axis] - 1, 1)
        if smallest > high or (largest < low and render_size[axis] > 1) or ratio < 1.0:
            raise FrameError(
                "size",
                got=f"{render_size} for a display of {display_size}: a ratio of {ratio:.3g} in {name}",
                want=f"a ratio from {low} to {high}",
                hint="Sizes are (width, height). No frame is larger than the display.",
            )


def only_ratio(ratios: tuple[float, float]) -> float | None:
    """Return the single ratio of a method whose range has equal ends; None for other ranges."""
    low, high = ratios
    return low if low == high else None


def scaled(size: Size, ratio: float) -> Size | None:
    """Return a size times `ratio`; None if the result is not whole pixels."""
    exact = Fraction(ratio).limit_denominator(1000)  # 0.333... is 1/3
    width, height = size[0] * exact, size[1] * exact
    return (int(width), int(height)) if width.denominator == height.denominator == 1 else None


def display_size_of(render_size: Size, scale: float) -> Size:
    """Return a render size times `scale`, in whole pixels; ArgumentError if that is not an image size."""
    return checked_size("display_size", (round(render_size[0] * scale), round(render_size[1] * scale)))


RATIOS: Mapping[str, float] = {
    "fsr_native_aa": 1.0, "fsr_quality": 1.5, "fsr_balanced": 1.7, "fsr_performance": 2.0,
    "fsr_ultra_performance": 3.0,
    "xess_native_aa": 1.0, "xess_ultra_quality_plus": 1.3, "xess_ultra_quality": 1.5, "xess_quality": 1.7,
    "xess_balanced": 2.0, "xess_performance": 2.3, "xess_ultra_performance": 3.0,
}  # fmt: skip
"""Display size / render size per axis, by vendor and mode. Frozen; XeSS as of 1.3, which renumbered."""

MipStyle = Literal["fsr", "log2"]


def jitter_phase_count(scale: float) -> int:
    """Return the length of the jitter sequence in frames: int(8 scale^2), at least 1.

    FSR's documentation says ceil(8 scale^2), its code truncates; this follows the code.

    Args:
        scale: display size / render size, > 0; if width and height differ in it, the square root of the
            product of both.

    Raises:
        ArgumentError: `scale` is not a finite number > 0.
    """
    return max(1, int(8.0 * _checked_scale(scale) ** 2))


def halton_jitter(index: int, scale: float) -> tuple[float, float]:
    """Return the jitter (x, y) of frame `index`: FSR's Halton(2, 3) sequence, in [-0.5, 0.5], never (0, 0).

    Args:
        index: number of the frame, >= 0; the sequence repeats after `jitter_phase_count(scale)` frames.
        scale: see `jitter_phase_count`.

    Raises:
        ArgumentError: `index` is negative, or `scale` is not a finite number > 0.
    """
    number = as_index(index)
    if number is None or number < 0:
        raise ArgumentError("index", got=shown(index), want="a frame number >= 0")
    phase = number % jitter_phase_count(scale) + 1
    return _halton(phase, 2) - 0.5, _halton(phase, 3) - 0.5


def mip_bias(scale: float, style: MipStyle = "fsr") -> float:
    """Return the bias of the texture level of detail for rendering below display size.

    Args:
        scale: display size / render size, > 0.
        style: "fsr" is log2(1 / scale) - 1, one level sharper than the display needs (FSR, Arm ASR);
            "log2" is log2(1 / scale), as sharp as the display needs (XeSS, Godot).

    Raises:
        ArgumentError: `scale` is not a finite number > 0, or `style` is unknown.
    """
    sharper = 1.0 if checked_choice("style", style, get_args(MipStyle)) == "fsr" else 0.0
    return -math.log2(_checked_scale(scale)) - sharper


def render_size_for(display_size: Size, mode: str | float) -> Size:
    """Return the (width, height) to render at, truncated to whole pixels as FSR does, at least 1 x 1.

    Args:
        display_size: (width, height) of the output.
        mode: a name of `RATIOS`, such as "fsr_quality" or "xess_balanced"; or a ratio >= 1.

    Raises:
        ArgumentError: the size is not two integers > 0, the mode is unknown, or the ratio is below 1.
    """
    width, height = checked_size("display_size", display_size)
    if isinstance(mode, str):
        mode = RATIOS[checked_choice("mode", mode, list(RATIOS), "A ratio >= 1 works, too.")]
    ratio = as_number(mode)
    if ratio is None or not 1.0 <= ratio < math.inf:
        want, hint = "a ratio display / render >= 1, or a mode's name", "2.0 is half size."
        raise ArgumentError("mode", got=shown(mode), want=want, hint=hint)
    # The tiny addend corrects the rounding of exact quotients, such as 2197 / 1.3.
    return max(1, int(width / ratio + 1e-6)), max(1, int(height / ratio + 1e-6))


def jittered_projection(
    matrix: ArrayLike, jitter: tuple[float, float], render_size: Size
) -> NDArray[np.floating[Any]]:
    """Return the projection that moves the image by - `jitter`: pixels are sampled at centre + jitter.

    Multiplies `matrix` by a translation in clip space from the left, for any projection and depth range.

    Args:
        matrix: (4, 4), row-major, acting on column vectors (clip = matrix @ view); clip space y points up.
            Transpose the matrix of an engine with row vectors (Direct3D, Unreal), before and after.
        jitter: (x right, y down) in render pixels.
        render_size: (width, height).

    Returns:
        (4, 4), of the type of `matrix` if that is a floating type, otherwise float64.

    Raises:
        ArgumentError: `matrix` is not 4 x 4, `jitter` not two finite numbers, or the size not whole and > 0.
    """
    projection = checked_matrix("matrix", matrix)
    width, height = checked_size("render_size", render_size)
    x, y = finite_jitter(jitter)
    translation = np.eye(4)
    translation[0, 3] = -2.0 * x / width
    translation[1, 3] = 2.0 * y / height  # clip y points up, jitter y down
    result: NDArray[np.floating[Any]] = translation @ projection
    return result.astype(projection.dtype) if np.issubdtype(projection.dtype, np.floating) else result


def _halton(index: int, base: int) -> float:
    result, fraction = 0.0, 1.0
    while index > 0:
        fraction /= base
        result += fraction * (index % base)
        index //= base
    return result


def _checked_scale(scale: float) -> float:
    number = as_number(scale)
    if number is None or not 0.0 < number <= MAX_SIDE:  # written so that NaN fails
        want = f"display size / render size, a number > 0, at most {MAX_SIDE}"
        raise ArgumentError("scale", got=shown(scale), want=want)
    return number


def checked_matrix(name: str, matrix: ArrayLike) -> NDArray[Any]:
    """Return a matrix as an array; ArgumentError if it is not 4 x 4 finite numbers."""
    try:
        array = np.asarray(matrix)
    except Exception:  # rows of several lengths, or an error of a user's class
        raise ArgumentError(name, got=shown(matrix), want="a 4 x 4 matrix") from None
    if array.shape != (4, 4):
        raise ArgumentError(name, got=f"of shape {array.shape}", want="a 4 x 4 matrix")
    if array.dtype.kind not in "iuf" or isinstance(matrix, np.ma.MaskedArray) or not np.isfinite(array).all():
        raise ArgumentError(name, got=shown(array.tolist()), want="a 4 x 4 matrix of finite numbers")
    return array


def finite_jitter(jitter: Sequence[float]) -> tuple[float, float]:
    """Return a jitter, not limited to one pixel, as two floats; ArgumentError if it is not finite numbers."""
    pair = [as_number(value) for value in jitter] if is_row(jitter) else []
    if len(pair) != 2 or not all(value is not None and math.isfinite(value) for value in pair):
        raise ArgumentError("jitter", got=shown(jitter), want="(x, y) in render pixels")
    return float(jitter[0]), float(jitter[1])
