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

from supersampler.conventions import Conventions, RawFrame, camera_motion, jittered_projection
from supersampler.frame import Frame

SIZE = (160, 90)
NEAR, FAR = 0.3, 500.0
JITTER = (0.25, -0.375)
NOW, BEFORE = (
    np.array([0.4, 0.3, -5.0, 1.0]),
    np.array([0.1, 0.35, -4.0, 1.0]),
)  # right, up, towards the viewer

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


# --- OpenGL, Direct3D and Vulkan: jittered projection, depth and motion agree bit for bit ---


WIDTH, HEIGHT = CLIP_SIZE = 64, 32
CLIP_NEAR, CLIP_FAR = 4.0, 8.0
# Numbers of few bits: sums and products of them are exact, so that no difference is rounding.
DEPTHS = {  # rows z of a right-handed projection to a depth from 0 to 1, and the fields of its Conventions
    "forward": ((-2.0, -8.0), {"near": CLIP_NEAR, "far": CLIP_FAR}),
    "forward_infinite": ((-1.0, -CLIP_NEAR), {}),
    "reversed": ((1.0, 8.0), {"near": CLIP_NEAR, "far": CLIP_FAR}),
    "reversed_infinite": ((0.0, CLIP_NEAR), {}),
}


def projection(kind: str) -> Matrix:
    """A Direct3D projection: depth from 0 to 1, y up."""
    matrix = np.diag([1.0, 2.0, 0.0, 0.0])
    matrix[2, 2:] = DEPTHS[kind][0]
    matrix[3, 2] = -1.0
    return matrix


def opengl(matrix: Matrix) -> Matrix:
    """Values of an engine with a depth from -1 to 1."""
    return np.array([matrix[0], matrix[1], 2.0 * matrix[2] - matrix[3], matrix[3]])


def negated_y(matrix: Matrix) -> Matrix:
    """Vulkan's clip space, whose y points down, or back."""
    return np.diag([1.0, -1.0, 1.0, 1.0]) @ matrix


def view(x: float, z: float) -> Matrix:
    """A camera that looks along -z, turned by a rotation of exact numbers."""
    matrix = np.eye(4)
    matrix[:3, :3] = [[0.75, 0.0, 0.5], [0.0, 1.0, 0.0], [-0.5, 0.0, 0.75]]
    matrix[:3, 3] = -x, 0.125, -z
    return matrix


CAMERAS = view(0.25, 0.5), view(0.0, 0.0)


def rasterized(matrix: Matrix, points: NDArray[Any], lowest: float, y_down: bool) -> NDArray[Any]:
    """Return (x, y from the top row, depth buffer) of points, as an API's viewport transform places them."""
    clip = points @ matrix.T
    x, y, z = (clip[..., :3] / clip[..., 3:]).T
    y = y if y_down else -y
    depth = (z - lowest) / (1.0 - lowest)
    return np.array([(x + 1.0) * WIDTH / 2.0, (y + 1.0) * HEIGHT / 2.0, depth.astype(np.float32)])


@pytest.mark.parametrize("kind", DEPTHS)
def test_a_jittered_frame_is_the_same_in_every_clip_space(kind: str) -> None:
    direct3d = projection(kind)
    grid = np.stack(
        np.meshgrid(np.arange(-4, 5) / 4, np.arange(-4, 5) / 8, [-4.0, -5.0, -6.0, -7.0]), axis=-1
    )
    in_view = np.concatenate([grid.reshape(-1, 3), np.ones((grid[..., 0].size, 1))], axis=1)
    jittered = jittered_projection(direct3d, JITTER, CLIP_SIZE)
    d3d = rasterized(jittered, in_view, 0.0, False)
    gl = rasterized(jittered_projection(opengl(direct3d), JITTER, CLIP_SIZE), in_view, -1.0, False)
    # Vulkan's y points down, in the projection that it gets: ours takes and returns y up.
    vulkan = rasterized(negated_y(jittered), in_view, 0.0, True)
    np.testing.assert_array_equal(vulkan, d3d)
    np.testing.assert_array_equal(gl, d3d)
    plain = rasterized(direct3d, in_view, 0.0, False)
    moved = (plain - d3d)[:2].T
    np.testing.assert_allclose(moved, np.broadcast_to(JITTER, moved.shape), atol=1e-13)
    np.testing.assert_array_equal(d3d[2], plain[2])
    stated = Conventions.from_json({"depth": kind, **DEPTHS[kind][1]})
    frame = converted(stated, d3d[2].astype(np.float32)[None], np.zeros((1, len(in_view), 2), np.float32))
    np.testing.assert_allclose(frame.depth[0], CLIP_NEAR / -in_view[:, 2], rtol=1e-6)


@pytest.mark.parametrize("kind", DEPTHS)
def test_a_frame_has_the_same_depth_and_motion_in_every_clip_space(kind: str) -> None:
    direct3d = projection(kind)
    depth = (np.arange(WIDTH * HEIGHT, dtype=np.float32) / (WIDTH * HEIGHT)).reshape(HEIGHT, WIDTH)
    depth[0] = 0.0 if kind.startswith("reversed") else 1.0  # the sky
    now, before = CAMERAS
    fields = {"depth": kind, **DEPTHS[kind][1]}
    frames = []
    for matrix, clip, bottom_up, y_down in (
        (direct3d, "zero_to_one", False, False),
        (opengl(direct3d), "minus_one_to_one", True, False),
        (negated_y(direct3d), "zero_to_one", False, True),
    ):
        y_up = negated_y(matrix) if y_down else matrix
        motion = camera_motion(depth, y_up @ now, y_up @ before, jitter=JITTER, clip=clip)  # type: ignore[arg-type]
        rows = slice(None, None, -1) if bottom_up else slice(None)
        stated = Conventions.from_json({**fields, "bottom_up": bottom_up})
        frames.append(converted(stated, depth[rows], motion[rows]))
    first, *others = frames
    assert np.isfinite(first.motion).all()
    assert np.abs(first.motion).max() > 1.0
    for other in others:
        np.testing.assert_array_equal(other.depth, first.depth)
        np.testing.assert_array_equal(other.motion, first.motion)
        assert other.jitter == first.jitter


@pytest.mark.parametrize("sign", [1, -1])
def test_the_preset_of_vtk_places_a_sample_where_the_window_centre_puts_it(sign: int) -> None:
    """VTK moves the frustum: the point at NDC c comes to the image's centre."""
    center = 2.0 * JITTER[0] / WIDTH, -2.0 * JITTER[1] / HEIGHT
    moved = np.eye(4)
    moved[:2, 3] = -center[0], -center[1]
    np.testing.assert_array_equal(
        moved @ projection("forward"), jittered_projection(projection("forward"), JITTER, CLIP_SIZE)
    )
    raw = RawFrame(
        depth=np.array([[1.0], [0.5]], np.float32),
        motion=np.zeros((2, 1, 2), np.float32),
        jitter=(0.25, 0.125 * sign),
    )
    frame = Conventions.vtk(near=CLIP_NEAR, far=CLIP_FAR).converter().to_frame(raw)
    assert frame.jitter == (0.125, -0.125 * sign)  # of 1 x 2 pixels
    np.testing.assert_allclose(
        frame.depth,
        [[CLIP_NEAR / (CLIP_FAR * CLIP_NEAR / (CLIP_FAR - 0.5 * (CLIP_FAR - CLIP_NEAR)))], [0.0]],
        rtol=1e-6,
    )


def converted(conventions: Conventions, depth: Any, motion: Any) -> Frame:
    return conventions.converter().to_frame(RawFrame(depth=depth, motion=motion, jitter=JITTER))
