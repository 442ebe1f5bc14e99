"""Motion from depth and two cameras, against points that are projected one by one in double precision."""

from typing import Any, Literal, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from supersampler.conventions import camera_motion, jittered_projection
from supersampler.errors import ArgumentError

WIDTH, HEIGHT = 64, 36
NEAR, FAR = 0.1, 1e4
JITTER = (0.21, -0.37)
Matrix = NDArray[np.float64]
Kind = Literal["reversed_infinite", "reversed", "forward", "forward_infinite", "opengl", "opengl_infinite"]
KINDS: tuple[Kind, ...] = get_args(Kind)


def perspective(kind: Kind, near: float = NEAR, far: float = FAR) -> Matrix:
    """A projection of right-handed view space, y up, 57 degrees high."""
    slopes = {
        "reversed_infinite": (0.0, near),
        "reversed": (near / (far - near), far * near / (far - near)),
        "forward": (-far / (far - near), -far * near / (far - near)),
        "forward_infinite": (-1.0, -near),
        "opengl": (-(far + near) / (far - near), -2.0 * far * near / (far - near)),
        "opengl_infinite": (-1.0, -2.0 * near),
    }
    matrix = np.diag([1.83 * HEIGHT / WIDTH, 1.83, 0.0, 0.0])
    matrix[2, 2:] = slopes[kind]
    matrix[3, 2] = -1.0
    return matrix


def view(position: tuple[float, float, float], yaw: float = 0.0) -> Matrix:
    cosine, sine = np.cos(yaw), np.sin(yaw)
    matrix = np.eye(4)
    matrix[:3, :3] = [[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]]
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


def clip_of(kind: Kind) -> Literal["zero_to_one", "minus_one_to_one"]:
    return "minus_one_to_one" if kind.startswith("opengl") else "zero_to_one"


def pixels_of(points: NDArray[Any], matrix: Matrix) -> NDArray[Any]:
    """Return (x, y) in pixels and the depth / w of world points (..., 4)."""
    clip = points @ matrix.T
    ndc = clip[..., :3] / clip[..., 3:]
    x, y, depth = np.moveaxis(ndc, -1, 0)
    return np.stack([(x + 1.0) * WIDTH / 2.0, (1.0 - y) * HEIGHT / 2.0, depth], axis=-1)


def sampled_points(
    distance: NDArray[Any], projection: Matrix, camera: Matrix, jitter: tuple[float, float] = JITTER
) -> NDArray[Any]:
    """World points (h, w, 4) at a view distance, where the pixels of a jittered frame sample."""
    x = (np.arange(WIDTH) + 0.5 + jitter[0]) * 2.0 / WIDTH - 1.0
    y = 1.0 - (np.arange(HEIGHT)[:, None] + 0.5 + jitter[1]) * 2.0 / HEIGHT
    across, up = x * distance / projection[0, 0], y * distance / projection[1, 1]
    points = np.stack([across, up, -distance, np.ones_like(distance)], axis=-1)
    return np.asarray(points @ np.linalg.inv(camera).T)


def distances(nearest: float = 0.3, farthest: float = 5e3) -> NDArray[Any]:
    rng = np.random.default_rng(7)
    return np.asarray(np.exp(rng.uniform(np.log(nearest), np.log(farthest), (HEIGHT, WIDTH))))


CURRENT, PREVIOUS = view((0.05, 0.1, 0.02), 0.01), view((0.0, 0.1, 0.0), 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_the_depth_of_a_frame_gives_the_same_motion(kind: Kind) -> None:
    projection, distance = perspective(kind), distances()
    points = sampled_points(distance, projection, CURRENT)
    truth = pixels_of(points, projection @ PREVIOUS) - pixels_of(points, projection @ CURRENT)
    motion = camera_motion(
        (NEAR / distance).astype(np.float32), projection @ CURRENT, projection @ PREVIOUS,
        jitter=JITTER, near=NEAR, clip=clip_of(kind),
    )  # fmt: skip
    np.testing.assert_allclose(motion, truth[..., :2], atol=1e-3)


@pytest.mark.parametrize("kind", ["reversed_infinite", "forward_infinite", "opengl_infinite"])
def test_the_sky_turns_with_the_camera_and_does_not_move_with_it(kind: Kind) -> None:
    projection = perspective(kind)
    turned = view((0.0, 0.1, 0.0), 0.01)
    directions = sampled_points(np.full((HEIGHT, WIDTH), 1.0), projection, turned)
    directions = directions - (0.0, 0.1, 0.0, 1.0)
    truth = pixels_of(directions, projection @ PREVIOUS) - pixels_of(directions, projection @ turned)
    sky = np.full((HEIGHT, WIDTH), 0.0 if kind == "reversed_infinite" else 1.0, np.float32)
    moved = view((3.0, -2.0, 1.0), 0.01)  # a camera that also moved sees the same sky
    for camera in (turned, moved):
        motion = camera_motion(
            sky, projection @ camera, projection @ PREVIOUS, jitter=JITTER, clip=clip_of(kind)
        )
        np.testing.assert_allclose(motion, truth[..., :2], atol=1e-3)
    assert np.abs(motion[..., 0]).min() > 0.2


def test_an_orthographic_camera_moves_every_depth_alike() -> None:
    projection = np.diag([0.5, 0.5 * WIDTH / HEIGHT, -1.0 / FAR, 1.0])
    depth = np.linspace(0.1, 0.9, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    motion = camera_motion(depth, projection @ view((1.0, 0.5, 0.0)), projection @ view((0.0, 0.0, 0.0)))
    np.testing.assert_allclose(
        motion, np.broadcast_to([0.5 * WIDTH / 2.0, -0.125 * WIDTH], motion.shape), atol=1e-4
    )


def test_motion_of_points_behind_the_previous_camera_leads_off_screen() -> None:
    projection = perspective("reversed_infinite")
    depth = np.full((HEIGHT, WIDTH), NEAR / 1.0, np.float32)  # a wall at a distance of 1
    ahead = view((0.0, 0.0, -2.0))  # the previous camera stood beyond it
    motion = camera_motion(depth, projection @ view((0.0, 0.0, 0.0)), projection @ ahead)
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    assert (columns + motion[..., 0]).max() < 0.0
    assert (rows + motion[..., 1]).max() < 0.0


@pytest.mark.parametrize("width", [WIDTH + 3, 17, 5, 1100])
def test_at_any_width_the_motion_is_the_projection_in_double_precision(width: int) -> None:
    projection = perspective("reversed_infinite")
    depth = np.random.default_rng(1).random((HEIGHT, width), np.float32) ** 4  # some of it behind
    current, previous = projection @ CURRENT, projection @ view((0.0, 0.1, -0.5), 0.3)
    columns, rows = np.meshgrid(np.arange(width) + 0.5 + JITTER[0], np.arange(HEIGHT) + 0.5 + JITTER[1])
    x, y = 2.0 * columns / width - 1.0, 1.0 - 2.0 * rows / HEIGHT
    clip = np.stack([x, y, depth, np.ones_like(x)], -1) @ (previous @ np.linalg.inv(current)).T
    behind = clip[..., 3] < 1e-6
    with np.errstate(all="ignore"):
        before = clip[..., :2] / clip[..., 3:]
    expected = np.stack([(before[..., 0] - x) * width / 2.0, (y - before[..., 1]) * HEIGHT / 2.0], -1)
    expected[behind] = -2 * width, -2 * HEIGHT
    motion = camera_motion(depth, current, previous, jitter=JITTER)
    np.testing.assert_array_equal(motion[..., 0] == -2 * width, behind)
    ordinary = np.abs(expected) < 1000.0  # beyond, the previous W is nearly 0, and rounding is amplified
    np.testing.assert_allclose(motion[ordinary], expected[ordinary], rtol=5e-5, atol=2e-4)
    assert 0 < behind.sum() < depth.size


@settings(max_examples=30, deadline=None)
@given(
    kind=st.sampled_from(KINDS),
    yaw=st.floats(-0.2, 0.2),
    move=st.tuples(*[st.floats(-0.1, 0.1)] * 3),
    jitter=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_any_small_move_is_exact(
    kind: Kind, yaw: float, move: tuple[float, float, float], jitter: tuple[float, float]
) -> None:
    projection, current = perspective(kind), view(move, yaw)
    points = sampled_points(distances(1.0, 500.0), projection, current, jitter)
    here, before = (pixels_of(points, projection @ camera) for camera in (current, PREVIOUS))
    written = (here[..., 2] + 1.0) / 2.0 if kind.startswith("opengl") else here[..., 2]
    depth, clip = written.astype(np.float32), clip_of(kind)
    motion = camera_motion(depth, projection @ current, projection @ PREVIOUS, jitter=jitter, clip=clip)
    np.testing.assert_allclose(motion, (before - here)[..., :2], atol=1e-3)
    jittered = pixels_of(points, jittered_projection(projection, jitter, (WIDTH, HEIGHT)) @ current)
    centres = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), axis=-1)
    np.testing.assert_allclose(jittered[..., :2], centres, atol=1e-9)


GOOD = perspective("reversed_infinite")
DEPTH = np.full((HEIGHT, WIDTH), 0.5, np.float32)


@pytest.mark.parametrize(
    ("name", "arguments", "options"),
    [
        ("depth", (DEPTH[..., None], GOOD, GOOD), {}),
        ("depth", (np.ones((4, 4), np.uint16), GOOD, GOOD), {}),
        ("view_projection", (DEPTH, np.eye(3), GOOD), {}),
        ("view_projection", (DEPTH, np.zeros((4, 4)), GOOD), {}),
        ("previous_view_projection", (DEPTH, GOOD, np.full((4, 4), np.nan)), {}),
        ("jitter", (DEPTH, GOOD, GOOD), {"jitter": (0.0, np.nan)}),
        ("clip", (DEPTH, GOOD, GOOD), {"clip": "0..1"}),
        ("near", (DEPTH, GOOD, GOOD), {"near": 0.0}),
        ("near", (DEPTH, np.diag([1.0, 1.0, 0.1, 1.0]), GOOD), {"near": 0.1}),
    ],
)
def test_a_wrong_argument_is_named(name: str, arguments: tuple[Any, ...], options: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError, match=rf"^{name}\b"):
        camera_motion(*arguments, **options)
