"""Static pixels freeze and stay bit-identical; `skip` changes no image; "off" averages nothing."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.backends.onnx.tensors import tensors_of_frame
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform

RENDER, DISPLAY = (54, 38), (81, 57)  # neither whole blocks nor whole tiles
RATIO = 1.5
PERIOD = jitter_phase_count(RATIO)
WAYS = [("taau", "cpu"), ("taau", "onnx"), ("classifier", "cpu"), ("classifier-large", "cpu")]


def make(method: str = "taau", executor: str = "cpu", threads: int = 1, **options: Any) -> Upscaler:
    model = shared_model(method, executor, threads=threads)
    return Upscaler(model, display_size=DISPLAY, validate="off", **options)


def waves(x: Any, y: Any) -> Float32:
    light = 0.4 + 0.25 * np.sin(0.9 * x) * np.sin(0.7 * y) + 0.1 * np.sin(0.11 * x + 0.17 * y)
    return np.asarray(light[..., None] * [0.5, 0.3, 0.2], np.float32)


def scene(index: int, *, spot: bool = False, size: Size = RENDER, **fields: Any) -> Frame:
    """A pattern that jitter samples, and a bright spot or none."""
    (w, h), jitter = size, halton_jitter(index, DISPLAY[0] / size[0])
    x = (np.arange(w) + 0.5 + jitter[0]) * RENDER[0] / w
    color = waves(x, (np.arange(h)[:, None] + 0.5 + jitter[1]) * RENDER[1] / h)
    if spot:
        color[20:24, 40:44] = 3.0
    given = {"depth": np.full((h, w), 0.1, np.float32), "motion": np.zeros((h, w, 2), np.float32)}
    return Frame(**{"color": color, **given, "jitter": jitter, "exposure": 1.0, **fields})


def run(upscaler: Upscaler, frames: Iterable[Frame | int]) -> Any:
    """Return the last result, with the map of what has converged."""
    for frame in frames:
        frame = scene(frame) if isinstance(frame, int) else frame
        result = upscaler.step(frame, outputs=("converged",))
    return result


def shown(image: Float32) -> Float32:
    return display_transform(image, 1.0)


@pytest.mark.parametrize(("method", "executor"), WAYS)
def test_a_still_scene_is_frozen_after_two_periods_and_stays_bit_for_bit(method: str, executor: str) -> None:
    upscaler = make(method, executor)
    assert upscaler.stats.converged == 0.0
    run(upscaler, range(2 * PERIOD - 1))
    assert upscaler.stats.converged == 0.0
    result: Any = run(upscaler, range(2 * PERIOD - 1, 2 * PERIOD + 2))
    assert upscaler.stats.converged == 1.0
    assert result.converged.min() == 1.0
    for index in range(2 * PERIOD + 2, 3 * PERIOD + 3):
        np.testing.assert_array_equal(upscaler.step(scene(index)), result.image)
    y, x = np.mgrid[0 : 4 * DISPLAY[1], 0 : 4 * DISPLAY[0]]
    fine = waves((x + 0.5) / (4 * RATIO), (y + 0.5) / (4 * RATIO))
    truth = fine.reshape(DISPLAY[1], 4, DISPLAY[0], 4, 3).mean((1, 3))
    assert np.abs(shown(result.image) - shown(truth.astype(np.float32))).mean() < 1.0 / 255.0


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-large"])
def test_skipping_changes_no_bit_of_images_maps_and_states(method: str) -> None:
    ours, theirs = make(method, threads=2), make(method, skip=False)
    changes = {2 * PERIOD + 5, 2 * PERIOD + 6, 4 * PERIOD + 9}
    for index in range(5 * PERIOD):
        frame = scene(index, spot=index in changes)
        mine, other = (each.step(frame, outputs=("converged",)) for each in (ours, theirs))
        np.testing.assert_array_equal(mine.image, other.image)
        np.testing.assert_array_equal(mine.converged, other.converged)
        if index == 3 * PERIOD:
            ours.load_state(ours.save_state())
    mine_state, other_state = (each.save_state().history or {} for each in (ours, theirs))
    for name, array in mine_state.items():
        np.testing.assert_array_equal(array, other_state[name], err_msg=name)


@pytest.mark.parametrize(("method", "executor"), WAYS)
def test_a_repeated_step_may_reuse_the_history_of_one_that_unfroze_a_part(method: str, executor: str) -> None:
    """Two steps from one history: the second writes to what the first, which unfroze a part, has left."""
    model = shared_model(method, executor)
    history = model.first_history(DISPLAY, RENDER)
    for index in range(2 * PERIOD + 2):
        _, history = model.run(scene(index), history)
    mask = np.zeros(RENDER[::-1], np.float32)
    mask[8:12, 8:20] = 0.5
    frame = scene(2 * PERIOD + 2)
    _, abandoned = model.run(replace(frame, reactive=mask), history)
    image, expected = model.run(frame, history)
    again, repeated = model.run(frame, history, history_out=abandoned)
    np.testing.assert_array_equal(again, image)
    np.testing.assert_equal(model.save_history(repeated), model.save_history(expected))


def test_skipping_changes_no_bit_where_frozen_surfaces_change_their_reflectance() -> None:
    """Beside tiles that move, the history of frozen ones is gathered, too."""
    model, display = shared_model("gbuffer-fast", "cpu"), (96, 64)
    ours, theirs = (
        Upscaler(model, display_size=display, validate="off", skip=skip) for skip in (True, False)
    )
    ones = np.ones((64, 96, 3), np.float32)
    depth = 0.1 * ones[..., 0]
    for index in range(24):
        speed = np.zeros((64, 96, 2), np.float32)
        speed[:, 80:] = float(index >= 20)
        buffers = {
            "base_color": (0.2 if index >= 20 else 0.8) * ones,
            "normal": ones * np.array([0, 0, 1], np.float32),
        }
        frame = Frame(
            color=(0.6 if index > 21 else 0.4) * ones + speed[..., :1],
            depth=depth,
            motion=speed,
            jitter=halton_jitter(index, 1.0),
            exposure=1.0,
            gbuffer=buffers,
            gbuffer_display={**buffers, "depth": depth},
        )
        np.testing.assert_array_equal(ours.step(frame), theirs.step(frame), f"frame {index}")
        assert (ours.stats.converged == 1.0) == (15 <= index < 20)


@pytest.mark.parametrize(("method", "executor"), WAYS)
def test_a_change_unfreezes_its_surroundings_in_the_same_frame(method: str, executor: str) -> None:
    upscaler = make(method, executor)
    before = run(upscaler, range(2 * PERIOD + 2)).image
    after = run(upscaler, [scene(2 * PERIOD + 2, spot=True)])
    frozen: Any = after.converged
    assert not frozen[30:36, 60:66].any()
    assert 0.7 < frozen.mean() < 1.0
    assert upscaler.stats.converged == pytest.approx(float(frozen.mean()))
    np.testing.assert_array_equal(after.image[frozen > 0.0], before[frozen > 0.0])
    assert after.image[30:36, 60:66].mean() > before.max()


@pytest.mark.parametrize("cell", [1, 2])
@pytest.mark.parametrize(("method", "executor"), WAYS)
def test_a_chequered_pattern_in_place_of_its_inverse_unfreezes_every_pixel(
    method: str, executor: str, cell: int
) -> None:
    upscaler = make(method, executor)
    columns, rows = (np.arange(extent) // cell for extent in RENDER)
    squares = (rows[:, None] + columns) % 2 == 0
    for index in range(2 * PERIOD + 2):
        color = np.where(squares[..., None], 0.6, 0.2).astype(np.float32).repeat(3, -1)
        upscaler.step(scene(index, color=color))
    assert upscaler.stats.converged == 1.0
    upscaler.step(scene(2 * PERIOD + 2, color=np.float32(0.8) - color))
    assert upscaler.stats.converged == 0.0


@pytest.mark.parametrize("change", [{"reset": True}, {"motion": np.full((38, 54, 2), 0.01, np.float32)}])
@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_cut_or_a_moving_camera_unfreezes_every_pixel(executor: str, change: dict[str, Any]) -> None:
    upscaler = make("taau", executor)
    run(upscaler, range(2 * PERIOD + 2))
    run(upscaler, [scene(2 * PERIOD + 2, **change)])
    assert upscaler.stats.converged == 0.0


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_at_rest_off_shows_the_methods_own_image(executor: str) -> None:
    mean, own = make("taau", executor), make("taau", executor, at_rest="off")
    rested = run(mean, range(2 * PERIOD + 2))
    result: Any = run(own, range(2 * PERIOD + 2))
    assert own.stats.converged == 0.0
    assert not result.converged.any()
    assert np.abs(result.image - rested.image).max() > 0.003
    assert np.abs(own.step(scene(3)) - result.image).max() > 0.0


def test_off_for_tensors_equals_off_for_arrays() -> None:
    session, arrays = (make("taau", "onnx", at_rest="off") for _ in range(2))
    for index in range(2 * PERIOD + 2):
        frame = scene(index)
        image = session.step_tensors(tensors_of_frame(frame, "cpu"), jitter=frame.jitter, exposure=1.0)
        expected = arrays.step(frame).transpose(2, 0, 1)[None]
        np.testing.assert_array_equal(np.from_dlpack(image), expected)
    assert session.stats.converged == 0.0


@pytest.mark.long  # hundreds of steps
@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_accumulate_averages_noise_without_end(executor: str) -> None:
    rng = np.random.default_rng(3)
    errors = {}
    upscalers = {way: make("taau", executor, at_rest=way) for way in ("accumulate", "converge", "off")}
    truth = run(make("taau", executor), range(2 * PERIOD + 2)).image
    for index in range(10 * PERIOD):
        frame = scene(index)
        noisy = (np.asarray(frame.color) * rng.gamma(4.0, 0.25, (*RENDER[::-1], 1))).astype(np.float32)
        for way, upscaler in upscalers.items():
            image = upscaler.step(replace(frame, color=noisy))
            errors[way] = float(np.abs(shown(image) - shown(truth)).mean())
    assert errors["converge"] == errors["off"]
    assert errors["accumulate"] < 0.7 * errors["off"]
    assert upscalers["accumulate"].stats.converged == 0.0


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_every_frame_may_have_another_size_and_what_rests_begins_anew_without_a_jump(executor: str) -> None:
    upscaler = make("taau", executor)
    sizes = ((48, 34), (81, 57), (41, 29), RENDER)
    before = run(upscaler, range(2 * PERIOD + 1)).image
    assert upscaler.stats.converged == 1.0
    for index in range(24):
        image = run(upscaler, [scene(index, size=sizes[index % 4])]).image
        again = make("taau", executor)
        again.load_state(upscaler.save_state())
        assert upscaler.stats.converged == 0.0
        assert np.abs(shown(image) - shown(before)).mean() < 6.0 / 255.0
        before = image
    frame = scene(99, size=sizes[0])
    np.testing.assert_array_equal(again.step(frame), upscaler.step(frame))
    run(upscaler, range(2 * PERIOD + 1))
    assert upscaler.stats.converged == 1.0
