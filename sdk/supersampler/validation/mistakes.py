"""List of all mistakes that the pixel checks and `detect_conventions` report.

`Mistake.found` replaces the names in braces.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import FrameError
from supersampler.io.display import MAX_EXPOSURE, MIN_EXPOSURE


@dataclass(frozen=True, slots=True)
class Mistake:
    """A mistake in one input, with the texts of its `FrameError`.

    Attributes:
        kind: identity of the mistake; each kind warns once until the next reset.
        field: field of `Frame`.
        got, want, hint: see `FrameError`.
        severity: "hint" if a correct frame may look the same; a hint warns, but never raises.
    """

    kind: str
    field: str
    got: str
    want: str
    hint: str = ""
    severity: Literal["error", "hint"] = "error"

    def found(self, **facts: Any) -> "Mistake":
        """Return the mistake with names in braces replaced by `facts`."""
        texts = ("kind", "field", "got", "want", "hint")
        return replace(self, **{name: getattr(self, name).format(**facts) for name in texts})

    def error(self) -> FrameError:
        """Return the error; the warning has the same text."""
        return FrameError(self.field, got=self.got, want=self.want, hint=self.hint)


def where(bad: NDArray[np.bool_]) -> str:
    """Return text with the number of True pixels in a mask, and the position of the first."""
    row, column = np.argwhere(bad)[0]
    return f"in {int(bad.sum())} pixels, first at (x={column}, y={row})"


_DEPTH = "near / distance, 0 at the sky"
_MOTION = "render pixels without jitter, previous minus current, y down"
_JITTER = "pixel centre to sample, render pixels, y down"

# fmt: off
COLOR_NOT_FINITE = Mistake(
    "color not finite", "color", "NaN or Inf {where}", "finite",
    "Is there a division by 0 or a power of a negative number in a shader? One such pixel would spread.")
COLOR_NEGATIVE = Mistake(
    "color negative", "color", "negative in {share:.0%} of its values", ">= 0",
    "Wide-gamut colours clip at 0: np.maximum(color, 0). Or a denoiser or sharpener has run before.")
COLOR_CLIPPED = Mistake(
    "color clipped", "color", "never above 1, and often 1 in one channel or two",
    "linear scene colour from before tone mapping",
    "If it is tone-mapped, pass it from before; if it is only sRGB, Conventions(srgb=True).",
    severity="hint")
COLOR_BYTES = Mistake(
    "color bytes", "color", "in whole numbers up to {high:.0f}",
    "linear scene colour from before tone mapping",
    "Are these bytes? Divide by 255. Bytes of image files are also sRGB: Conventions(srgb=True).")
COLOR_EIGHT_BIT = Mistake(
    "color eight bit", "color", "in steps of 1/255, as an 8-bit image", COLOR_BYTES.want,
    "Eight bits are sRGB: Conventions(srgb=True), or render to floats.", severity="hint")
COLOR_DISPLAYED = Mistake(
    "color displayed", "color", "never above {top}, and as bright as a displayed image", COLOR_BYTES.want,
    "{scale}Is it sRGB-encoded? Then Conventions(srgb=True); if it is tone-mapped, pass it from before.",
    severity="hint")
COLOR_FILTERED = Mistake(
    "color filtered", "color", "mixed at {share:.0%} of the depth edges",
    "point samples at pixel centre + jitter",
    "Turn off anti-aliasing, multi-sampling, blur and wide pixel filters (Blender: 0.01 pixels).",
    severity="hint")
ROWS_BOTTOM_UP = Mistake(
    "rows bottom-up", "color", "bottom-up with depth and motion: frames then fit {times:.1f} times better",
    "row 0 on top",
    "Conventions(bottom_up=True) flips all of them. Only if the image is upright: {call}.")
COLOR_UPSIDE_DOWN = Mistake(
    "color upside down", "color", "upside down relative to depth: flipped, edges agree {times:.1f}x better",
    "row 0 on top",
    "Flip one of them: array[::-1]; or Conventions(bottom_up=True) if all are upside down.")
DEPTH_NOT_FINITE = Mistake(
    "depth not finite", "depth", "NaN or Inf {where}", "finite",
    "Is it a distance? Conventions(depth='linear') takes inf for the sky.")
DEPTH_NEGATIVE = Mistake(
    "depth negative", "depth", "negative, as small as {low:.3g}", _DEPTH,
    "Depth in [-1, 1] is OpenGL's: write (d + 1) / 2. A view-space z is negative: write -z, depth='linear'.")
DEPTH_NOT_REVERSED = Mistake(
    "depth not reversed", "depth", "of another kind: {evidence}", _DEPTH,
    "Conventions(depth='{kind}', ...) converts it.")
DEPTH_FORWARD = replace(
    DEPTH_NOT_REVERSED,
    hint="Conventions(depth='forward', near=, far=) with the planes of the camera converts a z-buffer; "
    "depth='forward_infinite' is for one without a far plane.")
DEPTH_COARSE = Mistake(
    "depth coarse", "depth", "in {count} evenly spaced values", "floats, or 16 bits at least",
    "Is it from an 8-bit image? It is too coarse to find disocclusions, and its kind is not checked.",
    severity="hint")
DEPTH_CONSTANT = Mistake(
    "depth constant", "depth", "the same everywhere, although surfaces move at different speeds",
    "near / distance of each pixel", "Is the depth buffer bound, and read before it is cleared?")
MOTION_NOT_FINITE = Mistake(
    "motion not finite", "motion", "NaN or Inf {where}", "finite",
    "Write 0, or the camera's motion, where nothing was rendered, such as the sky.")
MOTION_TOO_LONG = Mistake(
    "motion too long", "motion", "longer than the whole image in {share:.0%} of the pixels", "render pixels",
    "Is it scaled twice? Vectors in pixels need motion_scale=(1, 1).")
MOTION_OFFSET = Mistake(
    "motion offset", "motion", "around ({x:.3g}, {y:.3g}) pixels everywhere, as if 0 were stored as 0.5",
    _MOTION, 'Subtract 0.5; for files, state the range in channels.json: "range": [-1, 1] (docs/shots.md).')
MOTION_OFFSET_PIXELS = replace(MOTION_OFFSET, severity="hint")
MOTION_MISREAD = Mistake(
    "motion misread", "motion", "misread: frames fit {times:.1f} times better if it is {reading}",
    _MOTION, "Try {call}.")
MOTION_ZERO = Mistake(
    "motion zero", "motion", "0 everywhere, although the image moves", _MOTION,
    "Is the pass written and read? Blender writes zeros while motion blur is on.")
MOTION_COARSE = Mistake(
    "motion coarse", "motion", "in steps of {step:.2g} pixels", "floats, in steps of 1/16 pixel or less",
    "Were vectors stored in 8 bits, or in half floats around 0.5? Store them around 0.")
MOTION_NEXT_MISREAD = Mistake(
    "motion_next misread", "motion_next",
    "inconsistent: from its end, the next frame's motion leads back {difference:.1f} pixels off, with "
    "vectors of {length:.1f}{reading}",
    "render pixels without jitter, next minus current, y down",
    "Conventions(motion_next_direction='current_minus_next') reverses it. If left out, it is computed.")
MOTION_SWAPPED = Mistake(
    "motion swapped", "motion", "(y, x): frames then fit better", "(x, y)", "Pass motion[..., ::-1].")
JITTER_CONSTANT = Mistake(
    "jitter constant", "jitter", "{jitter} in {frames} consecutive frames",
    "a new position in the pixel each frame, in render pixels",
    "halton_jitter and jittered_projection make one. Without jitter, no detail can be gained.")
JITTER_HELD = replace(
    JITTER_CONSTANT, got="{jitter} in {frames} frames in which nothing moved", severity="hint",
    hint="A static image needs samples at new positions: continue halton_jitter, or stop stepping.")
JITTER_ONE_SIDED = Mistake(
    "jitter one-sided", "jitter", "({x:.2f}, {y:.2f}) on average over {frames} shaded frames",
    "samples on all sides of the pixel's centre, (0, 0) on average",
    "If every second frame is not shaded, count shaded frames only: halton_jitter(index // 2, ratio).",
    severity="hint")
JITTER_TOO_SMALL = Mistake(
    "jitter too small", "jitter", "never more than {high:.2g}", JITTER_CONSTANT.want,
    "Try Conventions(jitter_unit='ndc') or 'uv'.")
JITTER_MISREAD = replace(MOTION_MISREAD, kind="jitter misread", field="jitter", want=_JITTER)
JITTER_NOT_APPLIED = Mistake(
    "jitter amplitude", "jitter", "not in the image, which stays in place", _JITTER,
    "Jitter the projection of each frame (jittered_projection), or pass (0, 0). If vectors contain it, too: "
    "Conventions(motion_jittered=True).")
JITTER_AMPLITUDE = Mistake(
    "jitter amplitude", "jitter", "{factor} times as large in the image as stated", _JITTER,
    "Is it computed for another size, such as Blender's without its resolution percentage?")
RESET_ALWAYS = Mistake(
    "reset always", "reset", "True in {frames} consecutive frames that continue each other",
    "True only on the first frame after a cut", "Each reset drops the history.")
JITTER_SWAPPED = Mistake(
    "jitter swapped", "jitter", "(y, x): frames then fit better", "(x, y)", "Pass (x, y).")
EXPOSURE_OUT_OF_RANGE = Mistake(
    "exposure out of range", "exposure", "{exposure:.3g}",
    f"{MIN_EXPOSURE:.2g} to {MAX_EXPOSURE:.2g}, which maps middle grey to 0.18",
    "It is ignored, and exposure is measured, as for exposure=None.")

GBUFFER_NOT_FINITE = Mistake(
    "{place} not finite", "{place}", "NaN or Inf {where}", "finite",
    "Clear the target to 0 where nothing is rendered, and do not normalise vectors of length 0.")
GBUFFER_DEPTH_NOT_FINITE = replace(
    GBUFFER_NOT_FINITE, hint="Is it a distance? The sky of near / distance is 0.")
GBUFFER_OUT_OF_RANGE = Mistake(
    "{place} out of range", "{place}",
    "outside [0, 1] in {share:.0%} of its values, from {low:.3g} to {high:.3g}", "linear, in [0, 1]",
    "It is a fraction of reflected light or a parameter of the material, without lighting or exposure.")
GBUFFER_BYTES = replace(
    GBUFFER_OUT_OF_RANGE,
    hint="Are these bytes? Divide by 255; convert a base colour from sRGB to linear, too.")
NORMAL_NOT_UNIT = Mistake(
    "{place} not unit", "{place}",
    "of a length that is neither 1 nor 0 in {share:.0%} of its pixels, from {low:.2g} to {high:.2g}",
    "world-space normals of unit length, 0 at the sky",
    "Normalise after the normal map is read, and do not average or resize.")
NORMAL_ENCODED = replace(
    NORMAL_NOT_UNIT,
    got="encoded: it fits n * 0.5 + 0.5",
    hint="Decode it: 2 * normal - 1, and 0 at the sky.")
GBUFFER_DEPTH_NEGATIVE = Mistake(
    "{place} negative", "{place}", "negative, as small as {low:.3g}",
    "near / distance, with the near plane of frame.depth, 0 at the sky")
GBUFFER_DEPTH_IS_DISTANCE = Mistake(
    "{place} of another kind", "{place}", "a distance: it grows where frame.depth falls",
    GBUFFER_DEPTH_NEGATIVE.want, "Write near / distance, with the near plane of frame.depth.")
GBUFFER_DEPTH_SCALED = replace(
    GBUFFER_DEPTH_IS_DISTANCE,
    got="{scale:.3g} times frame.depth at the same positions",
    hint="Is it forward, a distance, or does it have another near plane? Write both by the same code.")
# fmt: on

OF_REPROJECTION = {
    each.kind for each in (MOTION_OFFSET, MOTION_MISREAD, JITTER_MISREAD, ROWS_BOTTOM_UP, JITTER_AMPLITUDE)
}
"""Kinds of mistakes in what reprojection reads. Each makes the others seem to be there, so only the first one
is reported."""
OF_SRGB = {COLOR_CLIPPED.kind, COLOR_DISPLAYED.kind}
"""Kinds that are not mistakes in frames whose conventions state sRGB."""


def depth_kind(evidence: str, kind: str) -> Mistake:
    """Return the mistake that depth is "forward" or "linear", for this reason."""
    mistake = DEPTH_FORWARD if kind == "forward" else DEPTH_NOT_REVERSED
    return mistake.found(evidence=evidence, kind=kind)
