"""`classifier-large` on the GPU backend, at its own ratios; other files of this folder test it, too."""

from typing import Any

import pytest

from gpu_steps import assert_alike, device_or_skip, moving
from noise import Size, noise

METHOD = "classifier-large"


@pytest.fixture(scope="module", autouse=True)
def device() -> Any:
    return device_or_skip()


@pytest.mark.parametrize(
    ("render", "display"),
    [((1, 1), (1, 1)), ((1, 1), (2, 2)), ((2, 3), (4, 5)), ((17, 9), (17, 9)), ((17, 9), (34, 17))],
)
def test_odd_sizes_have_the_images_of_the_cpu(render: Size, display: Size) -> None:
    assert_alike(METHOD, [noise(seed, render) for seed in range(4)], display)


def test_render_sizes_that_change_keep_the_history_as_on_the_cpu() -> None:
    sizes = [(20, 12), (20, 12), (31, 19), (40, 24), (20, 12), (33, 13)]
    assert_alike(METHOD, [moving(index, size) for index, size in enumerate(sizes)])
