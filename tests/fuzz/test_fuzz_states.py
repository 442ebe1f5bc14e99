"""Any State loads and steps, or is refused with a typed error."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from fuzzing import HOSTILE, examples, hostile_array, run_apart
from still_states import DISPLAY, FRAMES, frame, still_state, upscaler
from supersampler import ArgumentError

Rng = np.random.Generator
SUBJECTS = [("taau", "cpu"), ("taa", "cpu"), ("classifier-small", "cpu"), ("taau", "onnx")]


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
