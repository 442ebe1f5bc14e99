"""Any State loads and steps, or is refused with a typed error."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from fuzzing import HOSTILE, examples, run_apart
from still_states import DISPLAY, FRAMES, frame, still_state, upscaler
from supersampler import ArgumentError

Rng = np.random.Generator
SUBJECTS = [("taau", "cpu"), ("taa", "cpu"), ("classifier-small", "cpu"), ("taau", "onnx")]
EXTREMES = (np.nan, np.inf, -np.inf, -1, 0, 1, 255, 2**31 - 1, -(2**31), 2**62, 1e30, -1e30, 1e-45, 3e38)


def hostile_array(array: Any, rng: Rng) -> Any:
    """A similar value, or an unrelated one."""
    if array.dtype.kind not in "biuf" or array.size > 1 << 20:  # it has been made so before
        return array
    match int(rng.integers(0, 12)):
        case 0:
            return HOSTILE[int(rng.integers(len(HOSTILE)))]
        case 1:
            return array[tuple(slice(None, None, int(rng.choice([1, 1, 2, -1]))) for _ in array.shape)]
        case 2:
            return array[tuple(slice(int(rng.integers(0, 2)), None) for _ in array.shape)]
        case 3:
            return np.zeros([int(rng.choice([0, 1, 2, 3, 40, 80])) for _ in array.shape], array.dtype)
        case 4:
            with np.errstate(all="ignore"):
                return array.astype(rng.choice(["f2", "f8", "i1", "i8", "u8", ">f4", "O", "?", "c16"]))
        case 5:
            side = int(rng.choice([1, 1 << 12, 1 << 16, 1 << 20]))
            return np.broadcast_to(array[(0,) * array.ndim], tuple(side if n > 4 else n for n in array.shape))
        case 6:
            return np.ma.MaskedArray(array)
        case 7:
            return array.T
        case 8:
            return np.frombuffer(rng.bytes(array.nbytes), array.dtype).reshape(array.shape)
        case _:
            changed = array.copy()
            with np.errstate(all="ignore"):
                extreme = np.float64(EXTREMES[int(rng.integers(len(EXTREMES)))]).astype(array.dtype)
            changed[rng.random(array.shape) < rng.choice([0.01, 0.5, 1.0])] = extreme
            return changed


def hostile_state(method: str, executor: str, rng: Rng) -> Any:
    """A state with one to three changes."""
    state = still_state(method, executor)
    for _ in range(int(rng.integers(1, 4))):
        if rng.random() < 0.85:
            field = "history" if rng.random() < 0.75 else "shaded"
            arrays = getattr(state, field)
            if not isinstance(arrays, dict) or not arrays:
                continue
            name = str(rng.choice(list(arrays)))
            changed = {**arrays, name: hostile_array(np.asarray(arrays[name]), rng)}
            match int(rng.integers(0, 12)):
                case 0:
                    del changed[name]
                case 1:
                    changed[f"{name}s"] = arrays[name]
            state = replace(state, **{field: changed})  # type: ignore[arg-type]
        else:
            field = str(rng.choice(["method", "display_size", "render_size", "history", "shaded", "version"]))
            values = (*HOSTILE, (2**40, 2**40), (1, 1), DISPLAY, [80, 48], (80, 47), (0, 0), (-80, 48))
            state = replace(state, **{field: values[int(rng.integers(len(values)))]})
    return state


def prepare() -> Callable[[int], object]:
    expected = {}
    for subject in SUBJECTS:
        one = upscaler(*subject)
        one.load_state(still_state(*subject))
        expected[subject] = one.step(frame(FRAMES)), one.extrapolate(frame(FRAMES + 1, color=None))

    def run(case: int) -> None:
        rng, subject = np.random.default_rng(case), SUBJECTS[case % len(SUBJECTS)]
        one = upscaler(*subject)
        one.load_state(still_state(*subject))
        try:
            one.load_state(hostile_state(*subject, rng))
        except ArgumentError:
            for image, want in zip(images_of(one), expected[subject], strict=True):
                np.testing.assert_array_equal(image, want)
            return
        for image in images_of(one):
            assert image.shape == (*DISPLAY[::-1], 3)
            assert np.isfinite(image).all()

    def images_of(one: Any) -> Any:
        yield one.step(frame(FRAMES))
        yield one.extrapolate(frame(FRAMES + 1, color=None))

    return run


def test_no_state_harms_its_reader_and_a_refused_one_changes_nothing() -> None:
    assert run_apart(prepare, examples(60)) == []
