"""A thin moving object leaves no trace where it was, and stays whole where it moves along itself."""

import pytest
import torch
from torch import Tensor

from gpu_steps import device_or_skip
from shared_models import shared_model
from supersampler import Upscaler
from supersampler.arguments import ExecutorName
from supersampler_model import ops
from thin_things import contrast, expected_depth, hostile, kept_depth, trace, upscaler_of

WALL, WIRE = 0.1, 0.5
METHODS = ["taau", "classifier", "classifier-small", "classifier-large"]
GPU = pytest.mark.long
RUNS = [
    *((method, "cpu") for method in METHODS),
    *(pytest.param(method, "gpu", marks=GPU) for method in ("taau", "classifier")),
]


def wire(over: tuple[float, float], *, level: bool = False, wall: float = 0.0) -> tuple[Tensor, Tensor]:
    """Depth and motion of a wire over a wall, which moves by `wall` to the right."""
    depth, motion = torch.full((1, 1, 12, 16), WALL), torch.zeros(1, 2, 12, 16)
    motion[:, 0] = wall
    where = (slice(None), slice(None), 5, slice(None)) if level else (..., slice(None), 7)
    depth[where] = WIRE
    motion[where] += torch.tensor(over).reshape(1, 2, 1)
    return depth, motion


@pytest.mark.parametrize("over", [(0.5, 0.0), (1.0, 0.0), (-1.5, 0.0), (4.0, 3.0), (1e6, 0.0)])
@pytest.mark.parametrize("wall", [0.0, -3.0])
def test_a_thin_object_that_moves_over_its_background_leaves(over: tuple[float, float], wall: float) -> None:
    depth, motion = wire(over, wall=wall)
    expected = torch.where(depth == WIRE, -depth, depth)
    torch.testing.assert_close(ops.occluding_depth(depth, motion), expected)


@pytest.mark.parametrize(
    ("over", "level"),
    [((0.0, 0.0), False), ((0.4, -0.4), False), ((0.0, 4.0), False), ((4.0, 0.0), True), ((-1.3, 0.0), True)],
)
def test_a_thin_object_at_rest_or_moving_along_itself_hides_nothing(
    over: tuple[float, float], level: bool
) -> None:
    depth, motion = wire(over, level=level)
    torch.testing.assert_close(ops.occluding_depth(depth, motion), torch.full_like(depth, WALL))


def test_a_thin_object_followed_by_another_hides_nothing() -> None:
    depth, motion = wire((4.0, 0.0))
    depth[..., 11] = WIRE  # comes to the place of the first
    found = ops.occluding_depth(depth, motion)
    assert (found[..., 7] == WALL).all()


def test_a_thin_object_before_an_unknown_background_hides_nothing() -> None:
    depth, motion = wire((4.0, 0.0))
    depth[..., 8] = -1.0
    opened = ops.morphological_opening(depth).clamp(min=0.0)
    torch.testing.assert_close(ops.occluding_depth(depth, motion), opened)


def test_broad_objects_hide_their_background_and_their_rear_edges_leave() -> None:
    depth, motion = torch.full((1, 1, 12, 16), WALL), torch.zeros(1, 2, 12, 16)
    depth[..., 3:9, 4:10] = WIRE
    for speed in (0.0, 0.4, 0.5, 4.0):
        motion[:, 0, 3:9, 4:10] = speed  # to the left
        expected = depth.clone()
        if speed >= 0.5:
            expected[..., 3:9, 9] = -WIRE
            expected[..., (3, 8), 10 - max(int(speed), 1) : 10] = -WIRE
        torch.testing.assert_close(ops.occluding_depth(depth, motion), expected)


@pytest.mark.parametrize("executor", ["cpu", "onnx", pytest.param("gpu", marks=GPU)])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(33, 17), (5, 40), (1, 1)])
def test_all_backends_keep_the_same_depth(method: str, executor: ExecutorName, size: tuple[int, int]) -> None:
    skip_without(executor)
    model = shared_model(method, executor=executor)
    for seed in range(4):
        frame = hostile(seed, size)
        upscaler = Upscaler(model, display_size=(2 * size[0], 2 * size[1]), validate="off")
        assert (kept_depth(upscaler, frame) == expected_depth(frame)).all()


def skip_without(executor: str) -> None:
    if executor == "gpu":
        device_or_skip()


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
@pytest.mark.parametrize(("method", "executor"), RUNS)
def test_a_thin_object_leaves_no_trace_where_it_was(method: str, executor: str, speed: float) -> None:
    skip_without(executor)
    upscaler = upscaler_of(method, executor=executor)
    assert trace(upscaler, speed) < 0.1


@pytest.mark.parametrize(("method", "executor"), RUNS)
def test_a_thin_object_that_moves_along_itself_stays_whole(method: str, executor: str) -> None:
    skip_without(executor)
    assert contrast(upscaler_of(method, executor=executor), 4.0) > 0.55
