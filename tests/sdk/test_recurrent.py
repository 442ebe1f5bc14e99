"""skip="recurrent": images are the method's own, also where nothing moves."""

import numpy as np
import pytest

from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.onnx.tensors import tensors_of_frame
from supersampler.model import ExecutorName

RENDER, DISPLAY = (40, 24), (80, 48)
PERIOD = 32  # of the jitter at 2x


def still(index: int) -> Frame:
    """A frame of fine stripes that stand still."""
    jitter = halton_jitter(index, 2.0)
    x = 2.0 * (np.arange(RENDER[0]) + 0.5 + jitter[0])
    y = 2.0 * (np.arange(RENDER[1])[:, None] + 0.5 + jitter[1])
    light = (0.5 + 0.4 * np.sin(2.1 * x + 0.7 * y))[..., None].repeat(3, -1).astype(np.float32)
    depth, motion = np.full(light.shape[:2], 0.1, np.float32), np.zeros((*light.shape[:2], 2), np.float32)
    return Frame(color=light, depth=depth, motion=motion, jitter=jitter, exposure=1.0)


def upscaler(executor: ExecutorName, skip: str) -> Upscaler:
    model = Model.load("taau", executor=executor, threads=1)
    return Upscaler(model, display_size=DISPLAY, skip=skip)  # type: ignore[arg-type]


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_nothing_is_averaged_where_nothing_moves(executor: ExecutorName) -> None:
    averaging, recurrent = upscaler(executor, "exact"), upscaler(executor, "recurrent")
    for index in range(PERIOD + 8):
        mean = averaging.step(still(index), outputs=("converged",))
        own = recurrent.step(still(index), outputs=("converged", "work"))
        assert own.converged is not None
        assert not own.converged.any()
    assert mean.converged is not None
    assert mean.converged.all()
    assert np.abs(own.image - mean.image).max() > 0.01  # the method's own still changes with the jitter
    assert own.work is not None
    assert own.work.all()
    assert recurrent.stats.converged == 0.0


def test_a_mean_that_a_loaded_state_holds_ends_when_its_pixels_move() -> None:
    averaging, recurrent = upscaler("cpu", "exact"), upscaler("cpu", "recurrent")
    for index in range(PERIOD + 8):
        averaging.step(still(index))
    recurrent.load_state(averaging.save_state())
    kept = recurrent.step(still(PERIOD + 8), outputs=("converged",))
    moved = still(PERIOD + 9)
    moved.motion[:] = 1.0
    recurrent.step(moved)
    after = recurrent.step(still(PERIOD + 10), outputs=("converged",))
    assert kept.converged is not None
    assert kept.converged.all()
    assert after.converged is not None
    assert not after.converged.any()


def test_a_graph_on_tensors_averages_nothing_either() -> None:
    session, arrays = upscaler("onnx", "recurrent"), upscaler("onnx", "recurrent")
    for index in range(PERIOD):
        frame = still(index)
        image = session.step_tensors(tensors_of_frame(frame, "cpu"), jitter=frame.jitter, exposure=1.0)
        expected = arrays.step(frame).transpose(2, 0, 1)[None]
        np.testing.assert_array_equal(np.from_dlpack(image), expected)
    assert session.stats.converged == 0.0
