"""One bad pixel never enters the history: images stay finite and >= 0, and the next clean frame recovers."""

import pickle
from dataclasses import replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from noise import noise
from shared_models import shared_model
from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler_model.data.scenes.analytic import Plane, checker

SIZE = (32, 18)
FEW = 1.5
"""A ratio whose jitter has few phases."""
METHODS = ["bilinear", "bicubic", "taa", "taau", "classifier"]
Models = dict[str, Model]
Images = dict[Any, Float32]
BAD = 4
LAST = BAD + 3 * jitter_phase_count(FEW)
"""Three jitter periods later: the bad samples differ from those after one; two more freeze it."""

Spoil = tuple[str, Any, float]
"""Field of a frame, its pixels, and their value."""
PLACES: dict[str, Any] = {
    "all": np.s_[:], "a tenth": np.random.default_rng(5).random(SIZE[::-1]) < 0.1, "a row": np.s_[7],
}  # fmt: skip


HOSTILE: dict[str, Spoil] = {
    f"{name} {where} {value}": (name, place, value)
    for name, values in {
        "color": [np.nan, np.inf, -np.inf, -1.0, 65504.0, 3e38, 1e-42],
        "depth": [np.nan, np.inf, -1.0, 0.0, 1e30, 1e-42],
        "motion": [np.nan, np.inf, -np.inf, 1e9, -1e5, 1e-42],
    }.items()
    for where, place in PLACES.items()
    for value in values
}


@pytest.fixture(scope="module", params=["onnx", "auto"])
def models(request: pytest.FixtureRequest) -> Models:
    return {name: shared_model(name, request.param) for name in METHODS}


@pytest.fixture(scope="module")
def clean(models: Models) -> Images:
    """The last image of each method where no frame was bad."""
    return {name: steps(make(model, FEW), 0, LAST) for name, model in models.items()}


@pytest.fixture(scope="module")
def last_images(models: Models) -> Images:
    """Last images by method and by the state after the hostile frame: many cases leave the same state."""
    return {}


@cache
def rendered(index: int, ratio: float) -> Frame:
    return Plane(checker).frame(index, SIZE, halton_jitter(index, ratio))


def still(index: int, ratio: float = 2.0, **overrides: Any) -> Frame:
    return replace(rendered(index, ratio), **{"reset": False, **overrides})


def steps(upscaler: Upscaler, first: int, last: int) -> Float32:
    """Step good frames at the ratio FEW and return the last image; all are finite."""
    for index in range(first, last + 1):
        image = upscaler.step(still(index, FEW))
        assert np.isfinite(image).all()
    return image


def make(model: Model, ratio: float = 2.0, **options: Any) -> Upscaler:
    return Upscaler(model, scale=ratio, render_size=SIZE, validate="off", **options)


@pytest.mark.long  # every method with every value
@pytest.mark.parametrize("case", HOSTILE)
@pytest.mark.parametrize("name", METHODS)
def test_a_hostile_frame_gives_a_clean_image_and_leaves_no_trace(
    models: Models, clean: Images, last_images: Images, name: str, case: str
) -> None:
    upscaler = make(models[name], FEW)
    steps(upscaler, 0, BAD - 1)
    field, place, value = HOSTILE[case]
    array = np.array(getattr(still(BAD, FEW), field))
    with np.errstate(over="ignore"):
        array[place] = value
    bad = upscaler.step(still(BAD, FEW, **{field: array}))
    assert np.isfinite(bad).all()
    assert bad.min() >= 0
    assert bad.max() <= 65504
    state = name, pickle.dumps(upscaler.save_state())
    if state not in last_images:
        last_images[state] = steps(upscaler, BAD + 1, LAST)
    off = np.abs(display_transform(last_images[state]) - display_transform(clean[name]))
    assert off.mean() < 0.004, "one step of an 8-bit image"
    assert np.quantile(off, 0.999) < 0.1


LAMPS = {
    "a channel a little below 0": ((0.9, 0.35, -1e-7), (0.9, 0.35, 0.0)),
    "a channel below 0": ((0.9, 0.35, -0.02), (0.9, 0.35, 0.0)),
    "beyond half floats": ((1e5, 9e4, 7e4), (65504.0, 65504.0, 65504.0)),
    "infinite": ((np.inf, np.inf, np.inf), (65504.0, 65504.0, 65504.0)),
}


@pytest.mark.parametrize("lamp", LAMPS)
@pytest.mark.parametrize("name", METHODS)
def test_a_lamp_that_stays_out_of_range_is_not_black(models: Models, name: str, lamp: str) -> None:
    value, want = LAMPS[lamp]
    upscaler = make(models[name], FEW)
    color = np.full((SIZE[1], SIZE[0], 3), 0.4, np.float32)
    color[5:13, 12:20] = value
    for index in range(2 * jitter_phase_count(FEW) + 1):
        image = upscaler.step(still(index, FEW, color=color))
        if index > 0:  # the first frame of a method may know an edge alone
            off = display_transform(image[12:15, 23:26]) - display_transform(np.array([[want]], np.float32))
            assert np.abs(off).max() < 0.03, index
    assert upscaler.stats.converged in (None, 1.0)


def test_a_bad_pixel_does_not_spread(models: Models) -> None:
    upscaler, innocent = make(models["taau"]), make(models["taau"])
    for seed in range(6):
        color = np.array(still(seed).color)
        color[9, 12] = np.nan
        image = upscaler.step(still(seed, color=color))
        expected = innocent.step(still(seed))
    changed = np.abs(image - expected).max(axis=-1) > 1e-3
    rows, columns = np.nonzero(changed)
    assert rows.size
    assert max(abs(rows - 19)) <= 8
    assert max(abs(columns - 25)) <= 8


@pytest.mark.parametrize("name", METHODS)
def test_lost_or_repeated_frames_leave_no_trace(models: Models, name: str) -> None:
    disturbed, calm = (make(models[name], FEW, at_rest="off") for _ in range(2))
    for index, (x, y) in enumerate(product((-0.5, 0.5), repeat=2)):
        frame = Plane(checker).frame(index, SIZE, (x, y))
        for _ in range(index % 3):
            disturbed.step(replace(frame, reset=False))
    off = np.abs(np.subtract(*(display_transform(steps(u, 4, LAST)) for u in (disturbed, calm))))
    assert off.mean() < 0.004, "one step of an 8-bit image"


def test_a_frame_7680_wide_is_upscaled(models: Models) -> None:
    upscaler = Upscaler(models["taau"], display_size=(7680, 4), validate="off")
    for seed in range(2):
        image = upscaler.step(noise(seed, (3840, 2)))
    assert image.shape == (4, 7680, 3)
    assert np.isfinite(image).all()
