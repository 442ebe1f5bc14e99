"""What stands still is not drawn again, and nothing else is missed."""

import pickle
from collections.abc import Iterator

import numpy as np
import pytest

from noise import Size
from supersampler import (
    ArgumentError,
    Frame,
    Model,
    Upscaler,
    display_transform,
    halton_jitter,
    jitter_phase_count,
    jitter_phase_count,
)
from supersampler.frame import Float32
from supersampler.host.skipping import TILE, Tiles

METHODS = ["taa", "taau", "classifier"]
RENDER: Size = (160, 112)
DISPLAY: Size = (320, 224)
SCALE = 1.5
PERIOD = jitter_phase_count(SCALE)
SETTLED = 2 * PERIOD - 1
"""Frames of a still scene before the first that is skipped."""


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    return {name: Model.load(name, executor="host", threads=2) for name in METHODS}


def scene(
    index: int, *, spot: tuple[int, int] | None = None, motion: float = 0.0, light: float = 1.0
) -> Frame:
    """A pattern that jitter samples; a bright spot at a sample's (x, y)."""
    w, h = RENDER
    jitter = halton_jitter(index, SCALE)
    x, y = np.arange(w) + jitter[0], np.arange(h)[:, None] + jitter[1]
    shade = np.sin(x * 0.9) * np.sin(y * 0.7) + np.sin(x * 0.11 + y * 0.17) + 2.0
    color = (shade[..., None] * [0.5, 0.3, 0.2] * light).astype(np.float32)
    if spot is not None:
        color[spot[1] : spot[1] + 3, spot[0] : spot[0] + 3] = 9.0
    depth = np.full((h, w), 0.1, np.float32)
    return Frame(
        color=color,
        depth=depth,
        motion=np.full((h, w, 2), motion, np.float32),
        jitter=jitter,
        exposure=1.0,
    )


def settled(model: Model, frames: int = SETTLED) -> Upscaler:
    upscaler = Upscaler(model, display_size=DISPLAY, validate="off")
    for index in range(frames):
        upscaler.step(scene(index))
    return upscaler


def pair(model: Model) -> Iterator[Upscaler]:
    for skip in ("auto", "exact"):
        yield Upscaler(model, display_size=DISPLAY, validate="off", skip=skip)  # type: ignore[arg-type]


def shown(image: Float32) -> Float32:
    return display_transform(image, 1.0)


@pytest.mark.parametrize("method", METHODS)
def test_a_still_scene_is_a_copy_after_two_periods_and_close_to_all_of_the_work(
    models: dict[str, Model], method: str
) -> None:
    skipping, exact = pair(models[method])
    works, images = [], []
    for index in range(3 * PERIOD):
        result = skipping.step(scene(index), want=("work",))
        assert not isinstance(result, np.ndarray)
        assert result.work is not None
        works.append(float(result.work.mean()))
        images.append(result.image)
        full = exact.step(scene(index))
    assert works[:SETTLED] == [1.0] * SETTLED
    assert works[SETTLED:] == [0.0] * (len(works) - SETTLED)
    assert np.array_equal(images[-1], images[-2])
    assert np.abs(shown(images[-1]) - shown(full)).mean() < (0.02 if method == "taa" else 0.004)
    assert skipping.stats.work == sum(works)
    assert exact.stats.work == exact.stats.full_frames == 3 * PERIOD


@pytest.mark.parametrize("method", METHODS)
def test_where_something_changes_all_that_it_reaches_is_drawn_as_without_skipping(
    models: dict[str, Model], method: str
) -> None:
    upscaler = settled(models[method])
    before = upscaler.step(scene(SETTLED))
    twin = Upscaler(models[method], display_size=DISPLAY, validate="off", skip="exact")
    twin.load_state(upscaler.save_state())
    frame = scene(SETTLED + 1, spot=(70, 50))
    image, full = upscaler.step(frame), twin.step(frame)
    work = models[method].work(upscaler._history)  # type: ignore[arg-type]
    drawn = np.kron(work == 1.0, np.ones((TILE, TILE)))[: DISPLAY[1], : DISPLAY[0]] > 0
    assert 0.0 < drawn.mean() < 0.5
    assert drawn[2 * 48 : 2 * 55, 2 * 68 : 2 * 75].all()
    assert np.array_equal(image[drawn], full[drawn])
    assert np.array_equal(image[~drawn], before[~drawn])


@pytest.mark.parametrize("change", [{"motion": 0.25}, {"light": 1.01}])
def test_a_change_is_seen_in_the_frame_that_it_comes_in(
    models: dict[str, Model], change: dict[str, float]
) -> None:
    upscaler = settled(models["classifier"], SETTLED + 3)
    result = upscaler.step(scene(SETTLED + 3, **change), want=("work",))  # type: ignore[arg-type]
    assert not isinstance(result, np.ndarray)
    assert result.work is not None
    assert result.work.min() == 1.0


def test_a_scene_that_changes_never_or_jitter_that_never_repeats_is_drawn_in_full(
    models: dict[str, Model],
) -> None:
    upscaler = Upscaler(models["taa"], display_size=DISPLAY, validate="off")
    for index in range(3 * PERIOD):
        frame = scene(0)
        upscaler.step(
            Frame(
                color=frame.color,
                depth=frame.depth,
                motion=frame.motion,
                jitter=(index / 128.0, 0.0),
                exposure=1.0,
            )
        )
    assert upscaler.stats.work == 3 * PERIOD


@pytest.mark.parametrize("method", METHODS)
def test_tiles_come_and_go_and_hold_what_they_showed(models: dict[str, Model], method: str) -> None:
    """A spot that comes back every period: tiles go from drawn to kept and back, in both buffers."""
    upscaler = settled(models[method], SETTLED + 1)
    exact = Upscaler(models[method], display_size=DISPLAY, validate="off", skip="exact")
    exact.load_state(upscaler.save_state())
    for index in range(SETTLED + 1, SETTLED + 3 * PERIOD):
        spot = (20, 20) if index % 5 == 0 else None
        image = upscaler.step(scene(index, spot=spot))
        full = exact.step(scene(index, spot=spot))
    assert upscaler.stats.work < upscaler.stats.frames
    assert np.abs(shown(image) - shown(full)).mean() < 0.02


def test_an_upscaler_that_loads_a_state_skips_as_the_saved_one_does(models: dict[str, Model]) -> None:
    upscaler = settled(models["classifier"], SETTLED + 2)
    other = Upscaler(models["classifier"], display_size=DISPLAY, validate="off")
    other.load_state(pickle.loads(pickle.dumps(upscaler.save_state())))  # noqa: S301
    for index in range(SETTLED + 2, SETTLED + 6):
        frame = scene(index, spot=(100, 40) if index == SETTLED + 4 else None)
        assert np.array_equal(upscaler.step(frame), other.step(frame))
    assert other.stats.work < 2.0


def test_a_cut_and_another_render_size_begin_anew(models: dict[str, Model]) -> None:
    upscaler = settled(models["taau"], SETTLED + 2)
    cut = scene(SETTLED + 2)
    upscaler.step(
        Frame(
            color=cut.color, depth=cut.depth, motion=cut.motion, jitter=cut.jitter, exposure=1.0, reset=True
        )
    )
    work = upscaler.stats.work
    for index in range(PERIOD):
        upscaler.step(scene(index))
    assert upscaler.stats.work == work + PERIOD


def test_the_number_of_threads_changes_no_bit_of_what_is_skipped() -> None:
    images = []
    for threads in (1, 2, 3):
        upscaler = settled(Model.load("classifier", executor="host", threads=threads), SETTLED + 1)
        spots = [(20, 20), None, (130, 90)]
        images.append([upscaler.step(scene(SETTLED + 1 + i, spot=s)) for i, s in enumerate(spots)])
    for other in images[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(images[0], other, strict=True))


def test_boxes_cover_every_tile_once() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        drawn = rng.random((7, 11)) < rng.random()
        tiles = Tiles(drawn)
        size = (11 * 32 - 7, 7 * 32 - 20)
        covered = np.zeros(size[::-1], int)
        for box in tiles.boxes(32, size):
            covered[box.y0 : box.y1, box.x0 : box.x1] += 1
        wanted = np.kron(drawn, np.ones((32, 32), int))[: size[1], : size[0]]
        assert covered.max(initial=0) <= 1
        assert (covered >= wanted).all()


def test_what_skip_does_not_know_is_an_error() -> None:
    with pytest.raises(ArgumentError, match="'auto' or 'exact'"):
        Upscaler("taa", display_size=DISPLAY, skip="always")  # type: ignore[arg-type]
