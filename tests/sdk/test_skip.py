"""Static tiles are not computed again, and no change is missed."""

import pickle
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from noise import Size
from supersampler import ArgumentError, Frame, Model, Upscaler, halton_jitter
from supersampler.backends.cpu.layout import TILE
from supersampler.backends.cpu.tiles import Tiles
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32
from supersampler.history import StepResult
from supersampler.io.display import display_transform

METHODS = ["taa", "taau", "classifier", "classifier-large"]
RENDER: Size = (160, 112)
DISPLAY: Size = (320, 224)
SCALE = 1.5
PERIOD = jitter_phase_count(SCALE)
MOST = 4 * PERIOD
"""Frames in which this scene comes to rest: this sequence is not the usual one of ratio 2."""


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    return {name: Model.load(name, executor="cpu", threads=2) for name in METHODS}


def scene(
    index: int, *, spots: Sequence[tuple[int, int]] = (), motion: float = 0.0, light: float = 1.0
) -> Frame:
    """A pattern that jitter samples; bright spots at samples (x, y)."""
    w, h = RENDER
    jitter = halton_jitter(index, SCALE)
    x, y = np.arange(w) + jitter[0], np.arange(h)[:, None] + jitter[1]
    shade = np.sin(x * 0.9) * np.sin(y * 0.7) + np.sin(x * 0.11 + y * 0.17) + 2.0
    color = (shade[..., None] * [0.5, 0.3, 0.2] * light).astype(np.float32)
    for left, top in spots:
        color[top : top + 3, left : left + 3] = 9.0
    depth = np.full((h, w), 0.1, np.float32)
    return Frame(
        color=color,
        depth=depth,
        motion=np.full((h, w, 2), motion, np.float32),
        jitter=jitter,
        exposure=1.0,
    )


def settled(model: Model) -> tuple[Upscaler, int]:
    """Return an upscaler in which a whole still scene rests, and the next frame's index."""
    upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
    for index in range(MOST):
        upscaler.step(scene(index))
        if upscaler.stats.converged == 1.0:
            return upscaler, index + 1
    raise AssertionError("never settled")


def twin(upscaler: Upscaler) -> Upscaler:
    """Return one in the same state that computes every tile."""
    other = Upscaler(upscaler.model, display_size=DISPLAY, validate="off", skip="exact")
    other.load_state(upscaler.save_state())
    return other


def work_of(upscaler: Upscaler, frame: Frame) -> tuple[Float32, Float32]:
    """Image and work of a step."""
    result = upscaler.step(frame, outputs=("work",))
    assert isinstance(result, StepResult)
    assert result.work is not None
    return result.image, result.work


def shown(image: Float32) -> Float32:
    return display_transform(image, 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_a_still_scene_is_copied_and_is_as_good(models: dict[str, Model], method: str) -> None:
    upscaler, index = settled(models[method])
    assert index > 2 * PERIOD
    exact = twin(upscaler)
    before = upscaler.step(scene(index))
    for k in range(index, index + PERIOD):
        image, work = work_of(upscaler, scene(k))
        full = exact.step(scene(k))
        assert work.max() == 0.0
        assert np.array_equal(image, before)
    assert np.abs(shown(image) - shown(full)).mean() < (0.02 if method == "taa" else 1.0 / 255.0)
    assert exact.stats.work == exact.stats.full_frames == PERIOD


@pytest.mark.parametrize("spots", [[(70, 50)], [(3, 3), (44, 3), (120, 4), (150, 100)]])
@pytest.mark.parametrize("method", METHODS)
def test_where_something_changes_all_that_it_reaches_is_computed_as_without_reuse(
    models: dict[str, Model], method: str, spots: list[tuple[int, int]]
) -> None:
    upscaler, index = settled(models[method])
    before = upscaler.step(scene(index))
    exact = twin(upscaler)
    frame = scene(index + 1, spots=spots)
    full = exact.step(frame)
    image, work = work_of(upscaler, frame)
    computed, reused = (
        np.kron(tiles, np.ones((TILE, TILE)))[: DISPLAY[1], : DISPLAY[0]] > 0
        for tiles in (work == 1.0, work == 0.0 if method == "classifier-large" else work < 1.0)
    )
    assert 0.0 < computed.mean() < 0.9
    as_full, as_before = ((image == other).all(-1) for other in (full, before))
    for x, y in spots:
        assert as_full[2 * y - 4 : 2 * y + 10, 2 * x - 4 : 2 * x + 10].all()
    assert as_before[reused].all()
    if method != "classifier-large":  # whose pixels are of several tiles of its larger image
        assert (as_full | as_before)[computed].all()


@pytest.mark.parametrize("change", [{"motion": 0.25}, {"light": 1.01}])
def test_a_change_is_seen_in_the_frame_that_it_comes_in(
    models: dict[str, Model], change: dict[str, float]
) -> None:
    upscaler, index = settled(models["classifier"])
    _, work = work_of(upscaler, scene(index, **change))  # type: ignore[arg-type]
    assert work.min() == 1.0


def test_a_scene_whose_jitter_never_repeats_is_computed_in_full(models: dict[str, Model]) -> None:
    upscaler = Upscaler(models["taa"], display_size=DISPLAY, validate="off")
    for index in range(3 * PERIOD):
        upscaler.step(replace(scene(0), jitter=(index / 128.0, 0.0)))
    assert upscaler.stats.work == 3 * PERIOD


def test_an_image_that_has_yet_to_forget_a_spike_of_light_is_not_kept(models: dict[str, Model]) -> None:
    upscaler, index = settled(models["taau"])
    calm = upscaler.step(scene(index))
    frame = scene(index + 1)
    color = np.array(frame.color)
    color[50:52, 70:72] = 65504
    upscaler.step(replace(frame, color=color))
    for k in range(index + 2, index + 2 + MOST):
        image = upscaler.step(scene(k))
    assert np.abs(shown(image) - shown(calm)).max() < 0.1


@pytest.mark.parametrize("method", METHODS)
def test_tiles_computed_and_reused_in_turns_hold_their_image(models: dict[str, Model], method: str) -> None:
    """A spot that appears every fifth frame: tiles are computed and reused in turns, in both buffers."""
    upscaler, index = settled(models[method])
    exact = twin(upscaler)
    for k in range(index, index + 3 * PERIOD):
        frame = scene(k, spots=[(20, 20)] if k % 5 == 0 else [])
        image, work = work_of(upscaler, frame)
        full = exact.step(frame)
        assert work.min() == 0.0
    assert np.abs(shown(image) - shown(full)).mean() < (0.02 if method == "taa" else 1.0 / 255.0)


def test_an_upscaler_that_loads_a_state_skips_as_the_saved_one_does(models: dict[str, Model]) -> None:
    upscaler = Upscaler(models["taau"], display_size=DISPLAY, validate="off")
    others = []
    for index in range(MOST):
        if index in (PERIOD + 3, 3 * PERIOD, MOST // 2):
            others.append(Upscaler(models["taau"], display_size=DISPLAY, validate="off"))
            others[-1].load_state(pickle.loads(pickle.dumps(upscaler.save_state())))  # noqa: S301
        image, work = work_of(upscaler, scene(index))
        for other in others:
            image_too, work_too = work_of(other, scene(index))
            assert np.array_equal(image, image_too)
            assert np.array_equal(work, work_too)
    assert work.max() == 0.0


def test_a_cut_begins_anew(models: dict[str, Model]) -> None:
    upscaler, index = settled(models["taau"])
    done = upscaler.stats.work
    for k in range(PERIOD):
        upscaler.step(replace(scene(index + k), reset=k == 0))
    assert upscaler.stats.work == done + PERIOD


def test_the_number_of_threads_changes_no_bit_of_what_is_skipped() -> None:
    images = []
    for threads in (1, 2, 3):
        upscaler, index = settled(Model.load("taau", executor="cpu", threads=threads))
        spots = [[(20, 20)], [], [(130, 90), (4, 90)]]
        images.append([upscaler.step(scene(index + i, spots=s)) for i, s in enumerate(spots)])
    for other in images[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(images[0], other, strict=True))


def test_with_a_larger_tolerance_tiles_settle_before_their_period_is_whole(models: dict[str, Model]) -> None:
    works = []
    for skip in (0.0, 0.05):
        upscaler = Upscaler(models["taau"], display_size=DISPLAY, validate="off", skip=skip)
        for index in range(5 * PERIOD):
            upscaler.step(scene(index))
        works.append(upscaler.stats.work)
    assert 2 * PERIOD == works[0] > works[1] > 2 * PERIOD - 4


def test_aovs_are_blended_in_every_frame(models: dict[str, Model]) -> None:
    upscaler, index = settled(models["taau"])
    aovs = np.ones((RENDER[1], RENDER[0], 1), np.float32)
    done = upscaler.stats.work
    upscaler.step(replace(scene(index), aovs=aovs), outputs=("aovs",))
    assert upscaler.stats.work == done + 1.0


def test_boxes_cover_every_tile_once() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        computed = rng.random((7, 11)) < rng.random()
        tiles = Tiles(computed)
        size = (11 * 32 - 7, 7 * 32 - 20)
        covered = np.zeros(size[::-1], int)
        for box in tiles.boxes(32, size):
            covered[box.y0 : box.y1, box.x0 : box.x1] += 1
        assert (tiles.computed >= computed).all()
        expected = np.kron(tiles.computed, np.ones((32, 32), int))[: size[1], : size[0]]
        assert covered.max(initial=0) <= 1
        assert np.array_equal(covered, expected)


def test_an_unknown_value_of_skip_is_an_error() -> None:
    for skip in ("always", -0.1, 1.5, float("nan")):
        with pytest.raises(ArgumentError, match="'auto', 'exact', 'accumulate', 'recurrent' or a number"):
            Upscaler("taa", display_size=DISPLAY, skip=skip)  # type: ignore[arg-type]
