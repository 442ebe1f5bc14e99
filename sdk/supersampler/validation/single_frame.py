"""Checks of one frame by itself."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32, Frame
from supersampler.io.display import EXPOSURES, usable_exposure
from supersampler.validation.depth_order import bend, sky_share
from supersampler.validation.mistake import Mistake, where
from supersampler.validation.reprojection import grid

_PLACES = 12_000


def mistakes_alone(frame: Frame, light: Float32 | None) -> Iterator[Mistake]:
    """Yield what is wrong with a frame by itself; `light` is the luminance of its colour."""
    if frame.color is not None and light is not None:
        yield from _color(frame.color, light)
    yield from _depth(frame.depth)
    yield from _motion(frame)
    yield from _exposure(frame.exposure)
    if light is not None:
        yield from _upside_down(frame.depth, light)


def _color(color: Array, light: Float32) -> Iterator[Mistake]:
    bad = ~np.isfinite(light)
    if bad.any():
        hint = "A division by 0 or a power of a negative number in a shader; one such pixel would spread."
        yield Mistake(
            kind="color not finite", field="color", got=f"NaN or Inf {where(bad)}", want="finite", hint=hint
        )
    rows, columns = grid((color.shape[1], color.shape[0]), _PLACES)
    values = color[rows, columns].astype(np.float32)
    negative = float(np.mean(values < -1e-6))
    if negative > 0.01:
        hint = "Wide-gamut colours clip at 0: np.maximum(color, 0). A denoiser or sharpener runs too early."
        got = f"negative in {negative:.0%} of its values"
        yield Mistake(kind="color negative", field="color", got=got, want=">= 0", hint=hint)
    full = (values == 1.0).sum(axis=1)  # white may well be 1 1 1, but a light clipped at 1 is seldom white
    if np.max(values, initial=0.0) <= 1.0 and np.mean((full == 1) | (full == 2)) > 0.005:
        hint = "If it is tone-mapped, hand it in from before; if it is only sRGB, Conventions(srgb=True)."
        got = "never above 1, and often 1 in one channel or two"
        want = "linear scene colour from before tone mapping"
        yield Mistake(kind="color clipped", field="color", got=got, want=want, hint=hint, only_a_hint=True)


def _depth(depth: Float32) -> Iterator[Mistake]:
    bad = ~np.isfinite(depth)
    want = "near / distance, 0 at the sky"
    if bad.any():
        hint = "Is it a distance? Conventions(depth='linear') takes inf for the sky."
        yield Mistake(
            kind="depth not finite", field="depth", got=f"NaN or Inf {where(bad)}", want="finite", hint=hint
        )
        return
    least, greatest = float(depth.min()), float(depth.max())
    if least < 0:
        got = f"negative, as small as {least:.3g}"
        hint = "Depth in [-1, 1] is OpenGL's: (d + 1) / 2. A view-space z is negative: -z, depth='linear'."
        yield Mistake(kind="depth negative", field="depth", got=got, want=want, hint=hint)
        return
    kind = _other_kind(depth, least, greatest)
    if kind:
        hint = f"Conventions(depth='{kind}', ...) converts it."
        got = f"of another kind: it looks {kind.replace('_', ', ')}"
        yield Mistake(kind="depth not reversed", field="depth", got=got, want=want, hint=hint)


def _other_kind(depth: Float32, least: float, greatest: float) -> str:
    """Guess the kind of a depth that is not reversed; "" where it may be right."""
    if least == greatest:
        return ""
    if greatest >= 1e6:  # a sky of 1e10 or so; near / distance has no such values
        return "linear"
    rows, columns = grid((depth.shape[1], depth.shape[0]), _PLACES)
    values = depth[rows, columns]
    if greatest == 1 and sky_share(values, "forward") > 0.02 and sky_share(values, "reversed") == 0:
        return "forward_infinite"
    # All within a tenth of the distance of the near plane, and yet one four times as near to it as another.
    if least >= 0.9 and greatest <= 1 and 1 - least >= 4 * (1 - greatest) and np.median(values) > 0.95:
        return "forward_infinite"
    as_reversed, as_linear = bend(depth, "reversed"), bend(depth, "linear")
    return "linear" if as_reversed > 2e-3 and as_linear < 0.1 * as_reversed else ""


def _motion(frame: Frame) -> Iterator[Mistake]:
    bad = ~np.isfinite(np.add(frame.motion[..., 0], frame.motion[..., 1], dtype=np.float32))
    if bad.any():
        hint = "Give 0, or the camera's motion, where nothing was drawn: at the sky, say."
        got = f"NaN or Inf {where(bad)}"
        yield Mistake(kind="motion not finite", field="motion", got=got, want="finite", hint=hint)
        return
    rows, columns = grid(frame.size, _PLACES)
    vectors = frame.motion[rows, columns].astype(np.float32)
    off = float(np.mean((np.abs(vectors) > np.array(frame.size, np.float32)).any(axis=1)))
    if off > 0.05 and min(frame.size) >= 16:
        hint = "Is it scaled twice? Vectors in pixels want no motion_scale but (1, 1)."
        got = f"longer than the whole image in {off:.0%} of the pixels"
        yield Mistake(kind="motion too long", field="motion", got=got, want="render pixels", hint=hint)
    if frame.depth.min() == frame.depth.max() > 0 and _not_a_plane(vectors, rows, columns):
        hint = "Is the depth buffer bound, and read before it is cleared?"
        got = "the same everywhere, though things move at different speeds"
        want = "near / distance of each pixel"
        yield Mistake(kind="depth constant", field="depth", got=got, want=want, hint=hint)


def _exposure(exposure: float | None) -> Iterator[Mistake]:
    if usable_exposure(exposure) is None and exposure is not None:
        yield Mistake(
            kind="exposure out of range",
            field="exposure",
            got=f"{exposure:.3g}",
            want=f"{EXPOSURES[0]:.2g} to {EXPOSURES[1]:.2g}, what brings middle grey to 0.18",
            hint="A measured one is used in its place, as for exposure=None.",
        )


def _not_a_plane(vectors: Float32, rows: NDArray[Any], columns: NDArray[Any]) -> bool:
    """Whether motion differs by more than half a pixel from what a flat card before the camera does."""
    if len(rows) < 8:
        return False
    basis = np.stack([np.ones(len(rows)), rows, columns], axis=1)
    fit = basis @ np.linalg.lstsq(basis, vectors, rcond=None)[0]
    return float(np.sqrt(np.mean((vectors - fit) ** 2))) > 0.5


def _upside_down(depth: Float32, light: Float32) -> Iterator[Mistake]:
    """Colour changes where depth does; if it does so only upside down, one of them is."""
    height, width = depth.shape
    rows, columns = grid((width, height - 1), 4 * _PLACES)
    here, below = depth[rows, columns], depth[rows + 1, columns]
    with np.errstate(invalid="ignore"):  # Inf - Inf; another check reports it
        edge = np.abs(here - below) > 0.1 * np.maximum(here, below)
    if edge.sum() < 200:
        return
    upright = _change(light, rows, columns, edge)
    turned = _change(light[::-1], rows, columns, edge)
    if turned > 1.5 and turned > 1.5 * upright:
        hint = "Turn one of them: array[::-1]; or Conventions(bottom_up=True) where all are upside down."
        got = f"upside down against depth: edges agree {turned / max(upright, 1e-6):.1f} times better turned"
        yield Mistake(kind="color upside down", field="color", got=got, want="row 0 on top", hint=hint)


def _change(light: Float32, rows: NDArray[Any], columns: NDArray[Any], edge: NDArray[np.bool_]) -> float:
    """Change of brightness from row to row at edges, in parts of the change anywhere."""
    here, below = np.maximum(light[rows, columns], 0), np.maximum(light[rows + 1, columns], 0)
    known = np.isfinite(here) & np.isfinite(below)
    if not (edge & known).any():
        return 0.0
    here, below, edge = here[known], below[known], edge[known]
    middle = max(float(np.median(here)), 1e-6)
    change = np.abs(here / (here + middle) - below / (below + middle))
    return float(change[edge].mean() / max(float(change.mean()), 1e-6))
