"""`guided-warp` on scenes whose light is known, and its parts."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from torch import Tensor

from lit_scene import LitScene, even
from supersampler import Frame, halton_jitter
from supersampler.frame import Float32
from supersampler_model import ops
from supersampler_model.methods.guided_warp import GuidedWarp, indices_of_smallest
from torch_inputs import step_by_name, tensors_of

SIZE = (64, 36)
INPUTS = ["color", *GuidedWarp.inputs()]
HISTORY = list(GuidedWarp.history)


def tensors(frame: Frame) -> dict[str, Tensor]:
    names = INPUTS if frame.color is not None else GuidedWarp.inputs()
    return tensors_of(frame, SIZE, names)


def extrapolated(frame: Frame, history: list[Tensor]) -> tuple[Float32, list[Tensor]]:
    image, history, _ = step_by_name(GuidedWarp(), tensors(frame), history)
    return image[0].numpy().transpose(1, 2, 0), history


def after(frame: Frame) -> list[Tensor]:
    return GuidedWarp.after_shaded(tensors(frame))


def second_of(
    scene: LitScene, jitters: tuple[tuple[float, float], ...] = ((0.0, 0.0), (0.0, 0.0))
) -> Float32:
    """Extrapolate frame 1 from frame 0."""
    return extrapolated(scene.frame(1, SIZE, jitters[1]), after(scene.frame(0, SIZE, jitters[0])))[0]


def off(image: Float32, frame: Frame) -> NDArray[np.float32]:
    """Relative errors of an image, (h, w)."""
    assert frame.color is not None
    return np.asarray((np.abs(image - frame.color) / np.maximum(frame.color, 0.05)).max(axis=-1))


@pytest.mark.parametrize("velocity", [(0.0, 0.0), (0.4, -0.3), (5.3, 2.6)])
def test_a_textured_plane_that_pans_is_reproduced(velocity: tuple[float, float]) -> None:
    scene, jitters = LitScene(velocity=velocity), ((-0.25, 0.4), (0.45, -0.3))
    now, then = scene.frame(1, SIZE, jitters[1]), scene.frame(0, SIZE, jitters[0])
    inner = np.s_[9:-9, 9:-9]
    assert off(second_of(scene, jitters), now)[inner].mean() < 0.06
    assert then.color is not None
    moved = np.roll(then.color, np.round(velocity).astype(int), axis=(1, 0))
    assert off(moved, now)[inner].mean() > 0.4  # its texture is as fine as pixels


@given(*(st.floats(-0.5, 0.5),) * 4, st.floats(-3.0, 3.0))
@settings(max_examples=20)
def test_light_is_read_where_the_sample_saw_it(x0: float, y0: float, x1: float, y1: float, v: float) -> None:
    """Light that rises evenly shows the position that it was read at, with any jitters."""

    def rising(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.stack([1.0 + x / 40.0, 1.0 + y / 40.0, np.ones_like(x)], axis=-1)

    scene = LitScene(base=even, light=rising, velocity=(v, -0.5 * v))
    image, now = second_of(scene, ((x0, y0), (x1, y1))), scene.frame(1, SIZE, (x1, y1))
    assert now.color is not None
    pixels_off = 80.0 * (image - now.color)[9:-9, 9:-9, :2]
    # Four samples are not even around every place: between two rows, two of them are of one column beside.
    assert np.abs(pixels_off).max() < 0.45


def test_disoccluded_pixels_take_light_from_similar_surfaces_nearby() -> None:
    scene = LitScene(radius=8.0, disc_velocity=(4.0, 1.0))
    uncovered = scene.uncovered(1)
    assert uncovered.sum() > 40
    image, now = second_of(scene), scene.frame(1, SIZE)
    assert off(image, now)[uncovered].mean() < 0.12
    before = scene.frame(0, SIZE).color
    assert before is not None
    assert off(before, now)[uncovered].mean() > 1.0


def test_surfaces_that_differ_only_in_depth_are_separated() -> None:
    scene = LitScene(base=even, radius=8.0, disc_velocity=(4.0, 1.0), disc_normal=(0.0, 0.0, 1.0))
    uncovered = scene.uncovered(1)
    assert off(second_of(scene), scene.frame(1, SIZE))[uncovered].max() < 0.1
    flat = LitScene(**{**vars(scene), "disc_depth": 0.01})
    assert off(second_of(flat), flat.frame(1, SIZE))[uncovered].mean() > 0.5


def test_off_screen_pixels_take_light_from_similar_surfaces_inside() -> None:
    scene = LitScene(velocity=(6.0, 0.0))
    entered = off(second_of(scene), scene.frame(1, SIZE))[:, :6]
    assert entered.mean() < 0.12
    assert entered.max() < 0.5


def test_the_sky_keeps_its_colour_and_takes_none_of_surfaces() -> None:
    scene = LitScene(sky=12.0)
    image = second_of(scene)
    np.testing.assert_allclose(image[:11], np.broadcast_to((0.3, 0.6, 1.2), (11, 64, 3)), rtol=1e-5)
    assert off(image, scene.frame(1, SIZE)).max() < 0.03


def test_black_surfaces_keep_what_they_reflect_besides() -> None:
    scene = LitScene(base=lambda x, y: 0.0 * even(x, y))
    shade = np.full((36, 64, 3), 0.2, np.float32)
    image, _ = extrapolated(scene.frame(1, SIZE), after(scene.frame(0, SIZE, color=shade)))
    np.testing.assert_allclose(image, 0.2, rtol=1e-5)


def test_without_a_shaded_frame_the_image_is_black() -> None:
    method, frame = GuidedWarp(), LitScene().frame(1, SIZE)
    nothing = method.first_history(ops.Size(*SIZE), ops.Size(*SIZE))
    assert extrapolated(frame, nothing)[0].max() == 0.0


# --- motion over several frames ---


@pytest.mark.parametrize("gap", [2, 3])
def test_several_unshaded_frames_in_a_row_show_the_scene_of_each(gap: int) -> None:
    scene, history = LitScene(velocity=(2.3, -1.4)), None
    for index in range(gap + 1):
        frame = scene.frame(index, SIZE, halton_jitter(index, 2.0))
        if history is None:
            history = after(frame)
            continue
        image, history = extrapolated(frame, history)
        assert off(image, frame)[9:-9, 9:-9].mean() < 0.07


def test_frames_of_another_size_are_extrapolated_from_a_shaded_one() -> None:
    scene = LitScene(velocity=(1.0, 0.5))
    _, history = extrapolated(scene.frame(1, (96, 54), (0.2, 0.1)), after(scene.frame(0, SIZE)))
    assert history[HISTORY.index("motion")].shape == (1, 2, 54, 96)
    assert history[HISTORY.index("color")].shape == (1, 3, 36, 64)
    image, _ = extrapolated(scene.frame(2, (80, 45), (-0.4, 0.3)), history)
    assert off(image, scene.frame(2, (80, 45), (-0.4, 0.3)))[9:-9, 9:-9].mean() < 0.07


# --- bad values ---


@pytest.mark.parametrize("name", ["color", "gbuffer_base_color", "gbuffer_normal", "depth"])
def test_a_nan_sample_is_never_taken(name: str) -> None:
    frame = LitScene(base=even, light=lambda x, y: 2.0 * even(x, y)).frame(0, SIZE)
    inputs, method = tensors(frame), GuidedWarp()
    inputs[name] = inputs[name].clone()
    inputs[name][:, :, 10, 10:14] = float("nan")
    history = method.after_shaded(inputs)
    for _ in range(3):
        image, history = extrapolated(LitScene(base=even).frame(1, SIZE), history)
        np.testing.assert_allclose(image, 0.5, rtol=1e-4)


# --- choosing ---


@given(
    st.integers(1, 6).flatmap(
        lambda n: st.lists(st.lists(st.integers(0, 9), min_size=n, max_size=n), min_size=4, max_size=33)
    )
)
def test_the_smallest_values_are_found_the_first_of_equal_ones(values: list[list[int]]) -> None:
    steps = [torch.tensor(row, dtype=torch.float32) / 16.0 for row in values]
    found = torch.stack(indices_of_smallest(steps, 4)).numpy()
    np.testing.assert_array_equal(found, np.argsort(np.array(values), axis=0, kind="stable")[:4])


def test_far_too_large_values_are_equal_and_come_last() -> None:
    numbers = indices_of_smallest([torch.tensor([v]) for v in (1e30, 3.0, 1e20, 2.0)], 4)
    assert [int(n) for n in numbers] == [3, 1, 0, 2]
