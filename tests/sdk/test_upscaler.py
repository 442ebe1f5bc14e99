"""`Upscaler` remembers one view, exactly, and a frame that is refused leaves it as it was."""

import copy
import gc
import pickle
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from ctypes import CDLL, CFUNCTYPE, c_size_t, c_void_p, cast
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cpu_models import cpu_model
from method_lists import WITH_KERNELS as TEMPORAL
from noise import Size, noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Model, Upscaler, halton_jitter
from supersampler.arguments import PresetName
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.model_file import model_names
from supersampler.upscaler import PRESETS

DISPLAY = (64, 36)
Models = dict[str, Model]
METHODS = ["bilinear", "bicubic", *TEMPORAL]


@pytest.fixture(scope="session")
def models() -> Models:
    return {name: shared_model(name) for name in METHODS}


def steps(upscaler: Upscaler, seeds: range) -> list[Float32]:
    return [upscaler.step(noise(seed)) for seed in seeds]


def make(model: Model, **options: Any) -> Upscaler:
    return Upscaler(model, display_size=DISPLAY, validate="off", **options)


def test_the_shipped_models_are_those_of_the_design() -> None:
    others = ["extrapolate", "gbuffer-fast", "gbuffer-small", "gbuffer-small-4x"]
    assert model_names() == sorted([*METHODS, *others])


@pytest.mark.parametrize("name", TEMPORAL)
def test_a_cut_drops_the_history(models: Models, name: str) -> None:
    upscaler = make(models[name])
    first, again = upscaler.step(noise(0)), upscaler.step(noise(0, reset=False))
    assert np.abs(again - first).max() > 1e-3  # history matters...
    np.testing.assert_array_equal(upscaler.step(noise(0)), first)  # ...until a cut
    upscaler.step(noise(1))
    upscaler.reset()
    np.testing.assert_array_equal(upscaler.step(noise(0, reset=False)), first)


@pytest.mark.parametrize("pixels", [1e3, -65504.0, 1e9])
@pytest.mark.parametrize("name", METHODS)
def test_motion_off_screen_finds_no_history(models: Models, name: str, pixels: float) -> None:
    upscaler = make(models[name], at_rest="off")
    for seed in range(4):
        frame = noise(seed, motion=np.full((18, 32, 2), pixels, np.float32), exposure=1.0)
        alone = make(models[name], at_rest="off").step(replace(frame, reset=True))
        off = np.abs(display_transform(upscaler.step(frame)) - display_transform(alone))
        assert off.mean() < 1e-5, seed


@pytest.mark.parametrize("name", METHODS)
def test_a_fork_continues_bit_for_bit(models: Models, name: str) -> None:
    upscaler, fork = make(models[name]), make(models[name])
    steps(upscaler, range(3))
    state = upscaler.save_state()
    later = steps(upscaler, range(3, 6))  # the state stays as it was saved
    fork.load_state(pickle.loads(pickle.dumps(state)))  # noqa: S301 - our own bytes
    np.testing.assert_array_equal(steps(fork, range(3, 6)), later)


@pytest.mark.parametrize("name", TEMPORAL)
def test_a_refused_frame_leaves_the_history_as_it_was(models: Models, name: str) -> None:
    upscaler, untouched = make(models[name]), make(models[name])
    steps(upscaler, range(2))
    steps(untouched, range(2))
    with pytest.raises(FrameError, match="color"):
        upscaler.step(noise(2, color=None))
    with pytest.raises(FrameError, match="size"):
        upscaler.step(noise(2, (128, 72)))
    with pytest.raises(ArgumentError, match="out"):
        upscaler.step(noise(2), out=np.empty((36, 64, 4), np.float32))
    np.testing.assert_array_equal(upscaler.step(noise(3)), untouched.step(noise(3)))
    assert upscaler.stats.frames == 3


@pytest.mark.parametrize("name", METHODS)
def test_the_image_goes_into_the_callers_buffer(models: Models, name: str) -> None:
    expected, out = make(models[name]).step(noise(0)), np.full((36, 64, 3), 7, np.float32)
    assert make(models[name]).step(noise(0), out=out) is out
    texture = np.zeros((36, 64, 4), np.float32)  # what engines have
    make(models[name]).step(noise(0), out=texture[..., :3])
    np.testing.assert_array_equal(texture[..., :3], out)
    assert not texture[..., 3].any()
    np.testing.assert_array_equal(out, expected)
    assert expected.dtype == np.float32
    assert expected.min() >= 0.0


def test_writing_into_a_returned_image_does_not_change_the_history(models: Models) -> None:
    careless, careful = make(models["taau"]), make(models["taau"])
    careless.step(noise(0))[:] = 1000
    careful.step(noise(0))
    np.testing.assert_array_equal(careless.step(noise(1)), careful.step(noise(1)))


@pytest.mark.parametrize("name", TEMPORAL)
def test_the_render_size_may_change_and_the_history_is_kept(models: Models, name: str) -> None:
    upscaler = make(models[name])
    sizes = [(32, 18), (43, 24), (64, 36), (22, 12), (16, 9)]
    most = models[name].info.ratios[1]
    for seed, size in enumerate(size for size in sizes if DISPLAY[0] / size[0] <= most):
        color, still = np.full((*size[::-1], 3), 2.0, np.float32), np.zeros((*size[::-1], 2), np.float32)
        flat = noise(seed, size, color=color, motion=still, depth=np.full(size[::-1], 0.1, np.float32))
        np.testing.assert_allclose(upscaler.step(flat), 2.0, rtol=1e-3)
    assert upscaler.stats.resets == 1


@pytest.mark.parametrize("ratio", [1.0, 1.3, 1.5, 1.7, 2.0, 2.3, 3.0, 4.0])
@pytest.mark.parametrize("size", [(23, 15), (1, 1), (1, 7), (9, 1)])
def test_any_ratio_keeps_a_flat_image_flat(models: Models, ratio: float, size: tuple[int, int]) -> None:
    for model in (model for model in models.values() if ratio <= model.info.ratios[1]):
        upscaler = Upscaler(model, scale=ratio, validate="off")
        for seed in range(3):
            image = upscaler.step(noise(seed, size, color=np.full((*size[::-1], 3), 0.7, np.float32)))
            np.testing.assert_allclose(image, 0.7, rtol=2e-3)
        assert upscaler.display_size == (round(size[0] * ratio), round(size[1] * ratio))


@pytest.mark.parametrize(
    ("display", "message"),
    [
        ((20, 36), r"a ratio of 0\.625 in width; want a ratio from 1\.0 to 4\.0"),
        ((64, 90), r"a ratio of 5 in height"),
    ],
)
def test_wrong_ratios_are_named(models: Models, display: tuple[int, int], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Upscaler(models["taau"], display_size=display, validate="off").step(noise(0))


def test_several_upscalers_share_one_model_from_several_threads(models: Models) -> None:
    expected = steps(make(models["taau"]), range(6))
    with ThreadPoolExecutor(4) as pool:
        for result in pool.map(lambda _: steps(make(models["taau"]), range(6)), range(4)):
            np.testing.assert_array_equal(result, expected)


def test_a_model_is_pure(models: Models) -> None:
    model = models["taau"]
    history = model.first_history(DISPLAY, (32, 18))
    image, left = model.run(noise(0), history)
    before = model.save_history(left)
    once, _ = model.run(noise(1), left)
    twice, _ = model.run(noise(1), left)
    np.testing.assert_array_equal(once, twice)
    for name, array in model.save_history(left).items():
        np.testing.assert_array_equal(array, before[name])
    np.testing.assert_array_equal(image, make(model).step(noise(0)))


def test_warming_up_changes_nothing(models: Models) -> None:
    warm, cold = make(models["taau"]), make(models["taau"])
    warm.warm_up((32, 18))
    warm.step(noise(0))
    cold.step(noise(0))
    warm.warm_up((32, 18))
    np.testing.assert_array_equal(warm.step(noise(1)), cold.step(noise(1)))
    with pytest.raises(ArgumentError, match="render_size"):
        make(models["taau"]).warm_up()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_an_upscaler_is_not_copied(models: Models, copied: Callable[[object], object]) -> None:
    upscaler, other = make(models["taau"]), make(models["taau"])
    for one in (upscaler, other):
        one.step(noise(0))
    with pytest.raises(ArgumentError, match=r"new\.load_state\(old\.save_state\(\)\)"):
        copied(upscaler)
    with pytest.raises(ArgumentError, match=r"model is to be copied or pickled; .*Model\.load"):
        copied(upscaler.model)
    with pytest.raises(ArgumentError, match=r"history is to be copied or pickled; .*save_history"):
        copied(upscaler.model.first_history((64, 36), (32, 18)))
    np.testing.assert_array_equal(upscaler.step(noise(1)), other.step(noise(1)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "display_size or scale is neither"),
        ({"display_size": (4, 4), "scale": 2}, "display_size or scale is both"),
        ({"scale": 0.5}, "scale is 0.5; want a number >= 1"),
        ({"scale": float("nan")}, "scale is nan"),
    ],
)
def test_bad_arguments_are_named(models: Models, arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ArgumentError, match=message):
        Upscaler(models["taau"], **arguments)  # type: ignore[arg-type]


def test_half_floats_are_taken(models: Models) -> None:
    frame = noise(0)
    color, motion = (np.asarray(array).astype(np.float16) for array in (frame.color, frame.motion))
    half = replace(frame, color=color, motion=motion)
    one, other = (make(models["taau"]).step(each) for each in (half, frame))
    np.testing.assert_allclose(one, other, rtol=5e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_sets_model_and_precision(name: PresetName) -> None:
    upscaler = Upscaler(preset=name, scale=2.0)
    model, precision = PRESETS[name]
    assert upscaler.model.info.method == model
    assert precision in ("auto", upscaler.model.precision)


@pytest.mark.parametrize("beside", [{"model": "taau"}, {"precision": "fp32"}, {"preset": "fastest"}])
def test_a_preset_goes_alone_and_exists(beside: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError, match="preset"):
        Upscaler(**{"preset": "fast", "scale": 2.0, **beside})


# --- plans state the memory and multiply-adds that a session has ---


PLANNED: tuple[Size, Size] = (160, 90), (320, 180)
LIBC = CDLL(None)
LIBC.malloc.restype, LIBC.malloc.argtypes = c_void_p, [c_size_t]
LIBC.free.restype, LIBC.free.argtypes = None, [c_void_p]


@pytest.mark.parametrize("method", TEMPORAL)
def test_the_bytes_of_a_plan_are_those_that_an_upscaler_takes(method: str) -> None:
    held = Counter[int]()

    def allocate(_: int | None, size: int) -> int | None:
        address: int | None = LIBC.malloc(size)
        held[address or 0] = size
        return address

    def release(_: int | None, address: int, size: int) -> None:
        assert held.pop(address) == size
        LIBC.free(address)

    callbacks = (
        CFUNCTYPE(c_void_p, c_void_p, c_size_t)(allocate),
        CFUNCTYPE(None, c_void_p, c_void_p, c_size_t)(release),
    )
    functions = dict(zip(("allocate", "release"), (cast(c, c_void_p) for c in callbacks), strict=True))
    model = cpu_model(method, threads=2, **functions)
    weights = held.total()
    plan: Any = model.plan(*PLANNED)
    still = noise(3, PLANNED[0])
    upscaler = Upscaler(model, display_size=PLANNED[1], validate="off")
    for index in range(jitter_phase_count(2.0) + 3):
        motion = np.zeros_like(still.motion)
        jitter = halton_jitter(index, 2.0)
        frame = Frame(color=still.color, depth=still.depth, motion=motion, jitter=jitter, exposure=1.0)
        upscaler.step(frame)
    taken = held.total() - weights
    assert taken == pytest.approx(plan.history_bytes + plan.working_bytes, rel=0.1)
    del upscaler, model
    gc.collect()
    assert held.total() == 0


@pytest.mark.parametrize("method", ["bilinear", "taau", "classifier", "classifier-large"])
def test_a_graphs_history_is_planned_by_its_shapes(method: str) -> None:
    model = shared_model(method, "onnx")
    plan = model.plan(*PLANNED)
    assert (plan.executor, plan.precision, plan.working_bytes) == ("onnx", "fp32", None)
    saved = model.save_history(model.first_history(*PLANNED[::-1]))
    assert plan.history_bytes == 2 * sum(array.nbytes for array in saved.values())


def test_multiply_adds_are_those_of_the_network() -> None:
    plan, small = (Upscaler.plan(*PLANNED, m) for m in ("classifier", "classifier-small"))
    assert plan.multiply_adds > 1.9 * small.multiply_adds > 1e8
    assert Upscaler.plan(*PLANNED, "taau").multiply_adds == 0
