"""The presets of engines, checked against what the engines' matrices and shaders compute.

A point moves. The engine's formulas (the presets' docstrings name their sources) give its stored vector, the
stored jitter, and the pixel where it is drawn. The converted frame must lead to the pixel where it was, and
say where in the pixel it was sampled.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame, jittered_projection

SIZE = (160, 90)
NEAR, FAR = 0.3, 500.0
JITTER = (0.25, -0.375)
NOW, BEFORE = np.array([0.4, 0.3, -5.0, 1.0]), np.array([0.1, 0.35, -4.0, 1.0])  # y up, z to the viewer

Matrix = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Drawn:
    """Values that an engine stores for a point, and the pixel it is drawn at."""

    motion: tuple[float, float]
    jitter: tuple[float, float]
    depth: float
    now: NDArray[np.float64]
    before: NDArray[np.float64]
    jittered: NDArray[np.float64]


def frustum(left: float, right: float, bottom: float, top: float) -> Matrix:
    """OpenGL's projection, as Unity and Godot have it; clip y up, z from -1 to 1."""
    return np.array([
        [2 * NEAR / (right - left), 0, (right + left) / (right - left), 0],
        [0, 2 * NEAR / (top - bottom), (top + bottom) / (top - bottom), 0],
        [0, 0, -(FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)],
        [0, 0, -1, 0],
    ])  # fmt: skip


PLANES = np.array([-0.24, 0.24, -0.135, 0.135])
TO_REVERSED = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -0.5, 0.5], [0, 0, 0, 1]])  # z from 1 to 0
FLIP = np.diag([1.0, -1.0, 1.0, 1.0])


def translated(x: float, y: float) -> Matrix:
    matrix = np.eye(4)
    matrix[:2, 3] = x, y
    return matrix


def ndc(matrix: Matrix, point: NDArray[np.float64]) -> NDArray[np.float64]:
    clip = matrix @ point
    return np.asarray(clip[:3] / clip[3])


def pixel(place: NDArray[np.float64], *, rows_follow_y: bool) -> NDArray[np.float64]:
    """Return where an NDC lies in a buffer; `rows_follow_y` where row 0 is at y = -1 (OpenGL, Vulkan)."""
    y = place[1] if rows_follow_y else -place[1]
    return (np.array([place[0], y]) * 0.5 + 0.5) * SIZE - 0.5


def unity(jittered: Matrix, *, top: bool) -> Drawn:
    """The GPU's projection is flipped where textures start at the top; memory follows the GPU's NDC."""
    gpu = TO_REVERSED @ (FLIP if top else np.eye(4))
    plain, moved = gpu @ frustum(*PLANES), gpu @ jittered
    now, before = ndc(plain, NOW), ndc(plain, BEFORE)
    velocity = (now - before)[:2] * (1, -1 if top else 1) * 0.5
    where = [pixel(place, rows_follow_y=not top) for place in (now, before, ndc(moved, NOW))]
    return Drawn((velocity[0], velocity[1]), JITTER, now[2], *where)


def unity_hdrp(*, top: bool) -> Drawn:
    left, right, bottom, upper = PLANES
    x, y = JITTER[0] * (right - left) / SIZE[0], JITTER[1] * (upper - bottom) / SIZE[1]
    return unity(frustum(left + x, right + x, bottom + y, upper + y), top=top)


def unity_urp(*, top: bool) -> Drawn:
    shift = translated(2 * JITTER[0] / SIZE[0], 2 * JITTER[1] / SIZE[1])
    return unity(shift @ frustum(*PLANES), top=top)


def upright(drawn: Drawn) -> Drawn:
    """Values of an engine whose rows start at the top of the image."""
    turned = [np.array([p[0], SIZE[1] - 1 - p[1]]) for p in (drawn.now, drawn.before, drawn.jittered)]
    return Drawn(drawn.motion, drawn.jitter, drawn.depth, *turned)


def godot() -> Drawn:
    """Vulkan's NDC has y down; the jitter is added after the flip and removed in the shader."""
    correction = TO_REVERSED @ FLIP
    stored = (2 * JITTER[0] / SIZE[0], 2 * JITTER[1] / SIZE[1])
    jittered = correction @ frustum(*PLANES)
    jittered += np.outer((*stored, 0, 0), frustum(*PLANES)[3])  # add_jitter_offset: the column of w
    np.testing.assert_allclose(-jittered[:2, 2], stored)  # what the preset's docstring reads it from
    now, before = ndc(correction @ frustum(*PLANES), NOW), ndc(correction @ frustum(*PLANES), BEFORE)
    motion = (before - now)[:2] * 0.5
    where = [pixel(place, rows_follow_y=True) for place in (now, before, ndc(jittered, NOW))]
    return Drawn((motion[0], motion[1]), stored, now[2], *where)


def unreal() -> Drawn:
    """Decoded velocity in NDC with y up; reversed depth without a far plane."""
    projection = frustum(*PLANES)
    projection[2] = 0, 0, 0, NEAR
    shift = translated(2 * JITTER[0] / SIZE[0], -2 * JITTER[1] / SIZE[1])
    now, before = ndc(projection, NOW), ndc(projection, BEFORE)
    velocity = (now - before)[:2]
    where = [pixel(place, rows_follow_y=False) for place in (now, before, ndc(shift @ projection, NOW))]
    return Drawn((velocity[0], velocity[1]), JITTER, now[2], *where)


def bgfx(*, bottom_left: bool) -> Drawn:
    """The velocity shader of docs/how-to/put-it-in-your-engine.md: current minus previous NDC."""
    projection = frustum(*PLANES)
    shift = translated(-2 * JITTER[0] / SIZE[0], 2 * JITTER[1] / SIZE[1] * (-1 if bottom_left else 1))
    now, before = ndc(projection, NOW), ndc(projection, BEFORE)
    velocity = (now - before)[:2]
    where = [pixel(p, rows_follow_y=bottom_left) for p in (now, before, ndc(shift @ projection, NOW))]
    return Drawn((velocity[0], velocity[1]), JITTER, (TO_REVERSED @ np.append(now, 1))[2], *where)


def bgfx_conventions(*, motion_flip_y: bool) -> Conventions:
    return Conventions(
        motion_unit="ndc", motion_direction="current_minus_previous", motion_flip_y=motion_flip_y,
        depth="reversed", near=NEAR, far=FAR,
    )  # fmt: skip


UPRIGHT = {"motion_flip_y": True, "jitter_flip_y": True}
PLANE = {"near": NEAR, "far": FAR}
CASES: dict[str, tuple[Callable[[], Drawn], Conventions]] = {
    "HDRP on Direct3D": (lambda: unity_hdrp(top=True), Conventions.unity(**PLANE)),
    "HDRP on OpenGL": (lambda: unity_hdrp(top=False), Conventions.unity(**PLANE)),
    "HDRP, upright": (lambda: upright(unity_hdrp(top=True)), Conventions.unity(**PLANE, **UPRIGHT)),
    "URP on Direct3D": (lambda: unity_urp(top=True), Conventions.unity(**PLANE, jitter_sign=-1)),
    "URP on OpenGL": (lambda: unity_urp(top=False), Conventions.unity(**PLANE, jitter_sign=-1)),
    "Godot": (godot, Conventions.godot(**PLANE)),
    "Unreal": (unreal, Conventions.unreal()),
    "bgfx": (lambda: bgfx(bottom_left=False), bgfx_conventions(motion_flip_y=False)),
    "bgfx on OpenGL": (lambda: bgfx(bottom_left=True), bgfx_conventions(motion_flip_y=True)),
}


@pytest.mark.parametrize("case", CASES)
def test_the_vectors_jitter_and_depth_of_an_engine_become_those_of_a_frame(case: str) -> None:
    draw, conventions = CASES[case]
    drawn = draw()
    ones = np.ones(SIZE[::-1], np.float32)
    motion = np.stack([ones * drawn.motion[0], ones * drawn.motion[1]], axis=-1)
    raw = RawFrame(depth=ones * drawn.depth, motion=motion, jitter=drawn.jitter)
    frame = conventions.converter().to_frame(raw)
    np.testing.assert_allclose(drawn.now + frame.motion[0, 0], drawn.before, atol=1e-4)
    np.testing.assert_allclose(drawn.jittered + frame.jitter, drawn.now, atol=1e-6)
    distance = -NOW[2]
    np.testing.assert_allclose(frame.depth[0, 0] * distance, NEAR, rtol=1e-4)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_preset_of_vtk_places_a_sample_where_the_window_centre_puts_it(sign: int) -> None:
    """VTK moves the frustum: the point at NDC c comes to the image's centre."""
    moved = translated(-2.0 * JITTER[0] / SIZE[0], 2.0 * JITTER[1] / SIZE[1]) @ frustum(*PLANES)
    np.testing.assert_allclose(moved, jittered_projection(frustum(*PLANES), JITTER, SIZE), atol=1e-15)
    depth, motion = np.array([[1.0], [0.5]], np.float32), np.zeros((2, 1, 2), np.float32)
    raw = RawFrame(depth=depth, motion=motion, jitter=(0.25, 0.125 * sign))
    frame = Conventions.vtk(near=4.0, far=8.0).converter().to_frame(raw)
    assert frame.jitter == (0.125, -0.125 * sign)  # of 1 x 2 pixels
    np.testing.assert_allclose(frame.depth, [[4.0 / (8.0 * 4.0 / 6.0)], [0.0]], rtol=1e-6)
