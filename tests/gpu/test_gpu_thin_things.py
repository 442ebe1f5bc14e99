"""On the GPU, too, a thin thing that moves leaves nothing where it was."""

import pytest

from gpu_steps import device_or_skip, model
from method_lists import WITH_SHADERS
from supersampler import Upscaler
from thin_things import contrast, expected_depth, hostile, kept_depth, trace, upscaler_of

device_or_skip()
METHODS = [method for method in WITH_SHADERS if method != "taa"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("size", [(33, 17), (5, 40), (1, 1)])
def test_the_kept_depth_is_that_of_torch(method: str, size: tuple[int, int]) -> None:
    for seed in range(4):
        frame = hostile(seed, size)
        upscaler = Upscaler(model(method), display_size=(2 * size[0], 2 * size[1]), validate="off")
        assert (kept_depth(upscaler, frame) == expected_depth(frame)).all()


@pytest.mark.parametrize("method", ["taau", "classifier"])
def test_a_thin_thing_leaves_no_trace_and_stays_whole_along_itself(method: str) -> None:
    assert trace(upscaler_of(method, executor="gpu"), 4.0) < (0.4 if method == "taau" else 0.15)
    assert contrast(upscaler_of(method, executor="gpu"), 4.0) > 0.55
