"""A thin moving object leaves no trace where it was, and stays whole where it moves along itself."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import torch

from gpu_steps import device_or_skip
from noise import Size, noise
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.arguments import ExecutorName
from supersampler.frame import Float32
from supersampler_model import ops
from supersampler_model.data.scenes import analytic
from supersampler_model.ops.motion import occluding_depth, usable_depth, usable_motion

RENDER, DISPLAY, RATIO = (96, 54), (192, 108), 2.0
FRAMES, BORDER = 20, 16


def hostile(seed: int, size: Size) -> Frame:
    """Return a frame of tiny objects that move at random; some depth and motion is not usable."""
    rng = np.random.default_rng(seed)
    shape = size[::-1]
    near = rng.random(shape) < 0.15
    depth = np.where(near, 1.0, 0.01).astype(np.float32) * rng.random(shape, np.float32)
    depth[rng.random(shape) < 0.02] = np.nan
    moves = rng.random((*shape, 1)) < 0.6
    motion = np.where(moves, rng.normal(0.0, 4.0, (*shape, 2)), 0.0).astype(np.float32)
    motion[rng.random(shape) < 0.02] = (np.inf, 3.0)
    motion[rng.random(shape) < 0.02] = (1e9, -1e9)
    return replace(noise(seed, size), depth=depth, motion=motion, reset=True)


def expected_depth(frame: Frame) -> Float32:
    """Return the occluding depth of a frame, (h, w), by the operation in torch."""
    depth, motion = (torch.from_numpy(np.array(values)) for values in (frame.depth, frame.motion))
    usable = usable_depth(depth[None, None]), usable_motion(motion.permute(2, 0, 1)[None])
    expected: Float32 = occluding_depth(*usable)[0, 0].numpy()
    return expected


def kept_depth(upscaler: Upscaler, frame: Frame) -> Float32:
    """Return the occluding depth, (h, w), that a step on a frame leaves in the history."""
    upscaler.step(frame)
    history = upscaler.save_state().history
    assert history is not None
    surface = next(name for name in history if name.endswith(("surface", "depth")))
    kept: Float32 = np.asarray(history[surface])[0, 0 if surface.endswith("surface") else 1]
    return kept


@dataclass(frozen=True)
class Wire(analytic.AnalyticScene):
    """A dark wire, 0.6 render pixels wide, in front of a static light wall.

    Attributes:
        speed: to the right, render pixels a frame.
        level: whether it is horizontal, and so moves along itself; otherwise it is nearly vertical.
    """

    speed: float
    level: bool = False

    WALL, DARK, START, LEAN = 0.9, 0.02, 8.3, 0.05
    WIDTH = 0.6 * analytic.EXTENT[0] / RENDER[0]

    @property
    def step(self) -> float:
        return self.speed * analytic.EXTENT[0] / RENDER[0]

    def middle(self, index: int, y: analytic.Values) -> analytic.Values:
        """Return the position of a vertical wire at these heights, units."""
        return self.START + self.step * index + self.LEAN * y

    def surface(self, index: int, x: analytic.Values, y: analytic.Values) -> analytic.SurfaceSample:
        off = y - 0.51 * analytic.EXTENT[1] if self.level else x - self.middle(index, y)
        is_wire = np.abs(off) < 0.5 * self.WIDTH
        depth = np.where(is_wire, analytic.NEAR, analytic.FAR)
        motion = np.where(is_wire[..., None], (-self.step, 0.0), 0.0)
        toward = np.broadcast_to((0.0, 0.0, 1.0), (*x.shape, 3))
        color = analytic.grey(np.where(is_wire, self.DARK, self.WALL))
        return analytic.SurfaceSample(color, depth, motion, depth, toward, toward)


def last_image(upscaler: Upscaler, scene: analytic.AnalyticScene) -> Float32:
    for index in range(FRAMES):
        image = upscaler.step(scene.frame(index, RENDER, halton_jitter(index, RATIO)))
    return image


def trace(upscaler: Upscaler, speed: float) -> float:
    """Return the sum of the wall's errors where an upright wire was before, as a fraction of a whole wire."""
    scene, scale = Wire(speed), DISPLAY[0] / analytic.EXTENT[0]
    left = int((scene.middle(FRAMES - 1, np.zeros(1))[0] - 2.0) * scale)
    error = np.abs(last_image(upscaler, scene)[:, :left].mean(axis=2) - scene.WALL).sum()
    whole = (scene.WALL - scene.DARK) * scene.WIDTH * scale * DISPLAY[1]
    return float(error / whole)


def contrast(upscaler: Upscaler, speed: float) -> float:
    """Return the contrast of a level wire that moves along itself: of its darkest row, 1 for a black one."""
    scene = Wire(speed, level=True)
    rows = last_image(upscaler, scene)[:, BORDER:-BORDER].mean(axis=(1, 2))
    return float((scene.WALL - rows.min()) / (scene.WALL - scene.DARK))


def upscaler_of(method: str, **options: Any) -> Upscaler:
    return Upscaler(method, display_size=DISPLAY, validate="off", **options)


WALL, WIRE = 0.1, 0.5
METHODS = ["taau", "classifier", "classifier-small", "classifier-large"]
GPU = pytest.mark.long
RUNS = [
    *((method, "cpu") for method in METHODS),
    *(pytest.param(method, "gpu", marks=GPU) for method in ("taau", "classifier")),
]


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
    model = shared_model(method, executor)
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
