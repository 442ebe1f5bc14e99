"""OpenGL, Direct3D and Vulkan: jittered projection, depth and motion agree bit for bit."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame, camera_motion, jittered_projection
from supersampler.frame import Frame

WIDTH, HEIGHT = SIZE = 64, 32
NEAR, FAR = 4.0, 8.0
JITTER = (0.25, -0.375)
Matrix = NDArray[np.floating[Any]]
# Numbers of few bits: sums and products of them are exact, so that a difference is no rounding.
DEPTHS = {  # rows z of a right-handed projection to a depth from 0 to 1, and the fields of its Conventions
    "forward": ((-2.0, -8.0), {"near": NEAR, "far": FAR}),
    "forward_infinite": ((-1.0, -NEAR), {}),
    "reversed": ((1.0, 8.0), {"near": NEAR, "far": FAR}),
    "reversed_infinite": ((0.0, NEAR), {}),
}


def projection(kind: str) -> Matrix:
    """A Direct3D projection: depth from 0 to 1, y up."""
    matrix = np.diag([1.0, 2.0, 0.0, 0.0])
    matrix[2, 2:] = DEPTHS[kind][0]
    matrix[3, 2] = -1.0
    return matrix


def opengl(matrix: Matrix) -> Matrix:
    """The same with a depth from -1 to 1."""
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
    jittered = jittered_projection(direct3d, JITTER, SIZE)
    d3d = rasterized(jittered, in_view, 0.0, False)
    gl = rasterized(jittered_projection(opengl(direct3d), JITTER, SIZE), in_view, -1.0, False)
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
    np.testing.assert_allclose(frame.depth[0], NEAR / -in_view[:, 2], rtol=1e-6)


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


@pytest.mark.parametrize("kind", DEPTHS)
def test_frame_depth_of_the_conventions_gives_the_motion_of_the_depth_buffer(kind: str) -> None:
    matrix = projection(kind)
    depth = np.random.default_rng(3).uniform(0.1, 0.9, (HEIGHT, WIDTH)).astype(np.float32)
    depth[0] = 0.0 if kind.startswith("reversed") else 1.0  # the far plane, or the sky
    now, before = (matrix @ camera for camera in CAMERAS)
    stated = Conventions.from_json({"depth": kind, "near": NEAR, **DEPTHS[kind][1]})
    frame = converted(stated, depth, np.zeros((HEIGHT, WIDTH, 2), np.float32))
    motion = camera_motion(depth, now, before, jitter=JITTER)
    by_frame = camera_motion(frame.depth, now, before, jitter=JITTER, near=NEAR)
    seen = slice(None) if kind.endswith("infinite") else slice(1, None)  # there the far plane becomes the sky
    np.testing.assert_allclose(by_frame[seen], motion[seen], atol=1e-3)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_preset_of_vtk_places_a_sample_where_the_window_centre_puts_it(sign: int) -> None:
    """VTK moves the frustum: the point at NDC c comes to the image's centre."""
    center = 2.0 * JITTER[0] / WIDTH, -2.0 * JITTER[1] / HEIGHT
    moved = np.eye(4)
    moved[:2, 3] = -center[0], -center[1]
    np.testing.assert_array_equal(
        moved @ projection("forward"), jittered_projection(projection("forward"), JITTER, SIZE)
    )
    raw = RawFrame(
        depth=np.array([[1.0], [0.5]], np.float32),
        motion=np.zeros((2, 1, 2), np.float32),
        jitter=(0.25, 0.125 * sign),
    )
    frame = Conventions.vtk(near=NEAR, far=FAR).converter().to_frame(raw)
    assert frame.jitter == (0.125, -0.125 * sign)  # of 1 x 2 pixels
    np.testing.assert_allclose(
        frame.depth, [[NEAR / (FAR * NEAR / (FAR - 0.5 * (FAR - NEAR)))], [0.0]], rtol=1e-6
    )


def converted(conventions: Conventions, depth: Any, motion: Any) -> Frame:
    return conventions.converter().to_frame(RawFrame(depth=depth, motion=motion, jitter=JITTER))
