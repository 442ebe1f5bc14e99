"""A state is loaded completely or refused; tampered values never reach kernels."""

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from still_states import FRAMES, frame, loaded, still_state, upscaler
from supersampler import ArgumentError, Upscaler
from supersampler.history import STATE_VERSION, State
from supersampler.recording import LoadStateCall, open_recording

STILL = ("history.static_mean", "history.static_blocks", "history.signatures", "history.phases")
CUTS: dict[str, Callable[[Any], Any]] = {
    "gone": lambda _: None,
    "empty": lambda array: array[..., :0] if array.ndim else np.zeros(0, array.dtype),
    "cut": lambda array: array[..., 1:] if array.ndim else np.zeros(1, array.dtype),
    "an axis more": lambda array: array[None],
    "of another type": lambda array: np.zeros(array.shape, np.float16),
    "of objects": lambda array: array.astype(object),
    "masked": np.ma.MaskedArray,
    "a list": lambda array: array.tolist(),
    "of the other byte order": lambda array: array.astype(array.dtype.newbyteorder()),
}


def with_array(state: State, name: str, array: Any, field: str = "history") -> State:
    arrays: Mapping[str, Any] = getattr(state, field)
    changed = {**arrays, name: array} if array is not None else {n: a for n, a in arrays.items() if n != name}
    return replace(state, **{field: changed})  # type: ignore[arg-type]


def assert_refused(state: Any, match: str) -> None:
    """By an Upscaler, which goes on as if it had never seen it."""
    one, other = upscaler(), upscaler()
    for each in (one, other):
        each.load_state(still_state())
    with pytest.raises(ArgumentError, match=match):
        one.load_state(state)
    np.testing.assert_array_equal(one.step(frame(FRAMES)), other.step(frame(FRAMES)))


def test_the_tested_state_holds_every_tensor() -> None:
    state = still_state()
    assert state.version == STATE_VERSION
    assert {*STILL, "history.color", "history.aovs"} <= set(state.history or ())
    assert ((state.history or {})["history.static_blocks"][0, 0] < 0.0).any()


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("name", [*STILL, "history.color", "history.jitter", "history.aovs"])
def test_an_array_that_is_not_as_the_method_has_it_is_refused(name: str, cut: str) -> None:
    state = still_state()
    array = CUTS[cut]((state.history or {})[name])
    if array is None and name == "history.aovs":
        return  # which a state need not have
    if cut == "of the other byte order" and array.dtype.itemsize == 1:
        return
    assert_refused(with_array(state, name, array), f"'{name.replace('.', '[.]')}'")


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("name", ["history.color", "history.motion"])
def test_an_array_of_the_wrong_shape_to_extrapolate_from_is_refused(name: str, cut: str) -> None:
    state = still_state()
    array = CUTS[cut]((state.shaded or {})[name])
    if cut == "cut" and name == "history.motion":
        array = array[:, :1]  # of another size it is that of another frame before
    assert_refused(with_array(state, name, array, "shaded"), "state.shaded is with.* 'history")


@pytest.mark.parametrize(
    ("name", "at", "value", "match"),
    [
        ("color", (0, 0, 0, 0), np.nan, "'history.color'"),
        ("samples", (0, 0, 0, 0), np.inf, "'history.samples'"),
        ("surface", (0, 0, 0, 0), -np.inf, "'history.surface'"),
        ("aovs", (0, 0, 0, 0), np.nan, "'history.aovs'"),
        ("jitter", (0, 0), 0.51, "'history.jitter'"),
        ("static_blocks", (0, 0, 0, 0), 1.5, "ages of blocks such as 1.5"),
        ("static_blocks", (0, 0, 0, 0), -(2.0**20) - 2.0, "ages of blocks from -1.04"),
        ("static_blocks", (0, 1, 0, 0), np.nan, "'history.static_blocks'"),
        ("static_mean", (0, 0, 0, 0), np.nan, "'history.static_mean'"),
        ("static_mean", (0, 0, 3, 3), -1.0, "colours from -1"),
        ("static_mean", (0, 2, 3, 3), 1e5, "colours from .* to 100000"),
        ("static_mean", (0, 3, 3, 3), -1.0, "weights from -1"),
        ("phases", (0, 0), 0.51, "jitter of phases"),
        ("phases", (0, 2), -1.0, "ages of phases"),
        ("phases", (0, 3), 0.25, "ages of phases such as 0.25"),
        ("signatures", (0, 0, 0, 0), np.inf, "'history.signatures'"),
    ],
)
def test_a_value_that_no_step_writes_is_refused(name: str, at: Any, value: float, match: str) -> None:
    state = still_state()
    array = (state.history or {})[f"history.{name}"].copy()
    array[at] = value
    assert_refused(with_array(state, f"history.{name}", array), match)


def test_invalid_pixels_of_a_shaded_history_are_taken_as_those_of_a_frame() -> None:
    one, color = upscaler(), np.array(frame(0).color)
    color[3, 4] = np.nan
    one.step(frame(0, color=color))
    other = upscaler()
    other.load_state(one.save_state())
    images = [each.extrapolate(frame(1, color=None)) for each in (one, other)]
    np.testing.assert_array_equal(images[0], images[1])
    assert np.isfinite(images[0]).all()
    jitter = np.full((1, 2), np.nan, np.float32)
    assert_refused(with_array(still_state(), "history.jitter", jitter, "shaded"), "history.jitter")


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"version": 1}, "state is of version 1; want 4"),
        ({"version": True}, "version True"),
        ({"version": "2"}, "version '2'"),
        ({"method": "taa"}, "of 'taa'"),
        ({"method": None}, "of None"),
        ({"method": []}, r"of \[\]"),
        ({"display_size": (2**40, 2**40)}, "state.display_size is"),
        ({"display_size": "80x48"}, "state.display_size is '80x48'"),
        ({"display_size": (80.0, 48)}, "state.display_size"),
        ({"display_size": None}, "without display_size or render_size"),
        ({"render_size": None}, "without display_size or render_size"),
        ({"render_size": (0, 24)}, "state.render_size is"),
        ({"render_size": (2**40, 1)}, "state.render_size is"),
        ({"render_size": (41, 24)}, "history.surface"),
        ({"history": 7}, "state is int; want arrays by name"),
        ({"history": []}, "state is list"),
        ({"history": {1: np.zeros(1)}}, "with 1"),
        ({"shaded": "x"}, "state.shaded is str"),
        ({"shaded": {}}, "without 'history.color'"),
    ],
)
def test_an_invalid_field_of_a_state_is_refused(changes: dict[str, Any], match: str) -> None:
    assert_refused(replace(still_state(), **changes), match)


def test_a_state_with_values_of_numpy_is_loaded_and_recorded(tmp_path: Path) -> None:
    state = still_state()
    values: dict[str, Any] = {
        "method": np.str_(state.method),
        "version": np.int64(state.version),
        "display_size": np.array(state.display_size),
        "render_size": np.array(state.render_size),
    }
    with upscaler(record=tmp_path / "recording") as one, upscaler() as other:
        one.load_state(replace(state, **values))
        other.load_state(state)
        assert one.display_size == other.display_size
        np.testing.assert_array_equal(one.step(frame(FRAMES)), other.step(frame(FRAMES)))
    loaded_call = next(iter(open_recording(tmp_path / "recording")))
    assert isinstance(loaded_call, LoadStateCall)
    assert loaded_call.state.display_size == state.display_size


def test_an_array_of_no_known_name_is_refused() -> None:
    state = still_state()
    more = np.zeros(1)
    assert_refused(with_array(state, "history.speed", more), "with 'history.speed'; want only history.color")
    assert_refused(with_array(state, "history.more", more, "shaded"), "with 'history.more'")


def test_a_pickled_state_without_a_version_is_refused() -> None:
    old = pickle.loads(pickle.dumps(still_state()))  # noqa: S301  # of our own
    del vars(old)["version"]
    assert_refused(pickle.loads(pickle.dumps(old)), "of version None; want 4")  # noqa: S301


def test_sizes_that_arrays_claim_without_memory_are_refused() -> None:
    """By numpy's strides a value may pass for an image of any size."""
    side = 1 << 14
    claimed = np.broadcast_to(np.float32(0.5), (1, 3, side, side))
    state = replace(still_state(), method="taa", shaded=None, display_size=(side, side * 2))
    with pytest.raises(ArgumentError, match=r"state\.display_size"):
        Upscaler(loaded("taa", "cpu"), scale=2.0).load_state(
            replace(state, history={"history.color": claimed})
        )
    shaded = dict(still_state().shaded or {})
    for name in [name for name, array in shaded.items() if array.ndim == 4]:
        shaded[name] = np.broadcast_to(np.float32(0.0), (*shaded[name].shape[:2], 1 << 16, 40))
    assert_refused(replace(still_state(), shaded=shaded), "each named extent")


def test_a_loaded_state_shares_no_memory() -> None:
    state = pickle.loads(pickle.dumps(still_state()))  # noqa: S301  # of our own
    one, other = upscaler(), upscaler()
    one.load_state(state)
    other.load_state(still_state())
    for arrays in (state.history, state.shaded):
        for array in (arrays or {}).values():
            array[...] = 0
    for index in (FRAMES - 1, FRAMES):
        np.testing.assert_array_equal(one.step(frame(index)), other.step(frame(index)))
    images = [each.extrapolate(frame(9, color=None, reset=False)) for each in (one, other)]
    np.testing.assert_array_equal(images[0], images[1])


def test_a_state_from_before_the_first_frame_drops_the_history() -> None:
    one, other = (Upscaler(loaded("taau", "cpu"), scale=2.0, validate="off") for _ in range(2))
    start = one.save_state()
    images = [one.step(frame(index)) for index in (1, 2)]
    for each in (one, other):
        each.load_state(start)
        np.testing.assert_array_equal([each.step(frame(index)) for index in (1, 2)], images)
