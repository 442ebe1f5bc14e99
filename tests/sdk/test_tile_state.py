"""Which tiles count as static, and when a scene has too few of them for reuse."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from supersampler import halton_jitter
from supersampler.backends.cpu.layout import RENDER_TILE
from supersampler.backends.cpu.static_tiles import HOLD_FRAMES, LOOK_FRAMES, MOVING, Bool, StaticTiles, Sums
from supersampler.backends.cpu.tile_state import UNSTEADY_FRAMES, TileState
from supersampler.conventions import jitter_phase_count

RATIO = 1.5
PERIOD = jitter_phase_count(RATIO)


def reader(sums: NDArray[np.int64]) -> Callable[[Bool, int], Sums]:
    return lambda _, __: sums.astype(np.uint64)


def test_noise_everywhere_is_looked_at_once_in_eight_frames_until_it_ends() -> None:
    period, reads = 16, 0
    tiles = StaticTiles.empty((2 * RENDER_TILE, RENDER_TILE))

    def after(index: int, sums: NDArray[np.int64]) -> StaticTiles:
        def read(_: Bool, __: int) -> Sums:
            nonlocal reads
            reads += 1
            return sums.astype(np.uint64)

        return tiles.after((index % period / 32.0, 0.0), read)

    for k in range(4 * period):
        if k == 3 * period:
            reads = 0
        tiles = after(k, np.array([[2 * k + 1, 2 * k + 2]]))
    assert reads <= 2 * period // 8
    assert tiles.changed.all()
    for k in range(3 * period):
        tiles = after(k, np.array([[500 + k % period, 9]]))
    assert tiles.same.all()


def test_tiles_are_held_after_a_confirmed_period_and_else_changed() -> None:
    tiles, still = StaticTiles.empty((2 * RENDER_TILE, RENDER_TILE)), np.array([[7, 9]])
    for k in range(2 * 4):
        tiles = tiles.after((k % 4 / 8.0, 0.0), reader(still))
    assert tiles.confirmed.all()
    other = np.array([[7, 10]])
    for k in range(HOLD_FRAMES):
        tiles = tiles.after((k / 8.0, 0.0), reader(other))
        assert tiles.held.tolist() == [[False, True]]
        assert tiles.same.tolist() == [[True, False]]
    tiles = tiles.after((HOLD_FRAMES / 8.0, 0.0), reader(other))
    assert tiles.changed.tolist() == [[False, True]]
    assert tiles.confirmed.tolist() == [[True, False]]


def test_a_tile_that_moved_is_compared_with_its_last_frame_without_motion() -> None:
    tiles, still = StaticTiles.empty((2 * RENDER_TILE, RENDER_TILE)), np.array([[7, 9]])
    for sums in (still, np.array([[7, MOVING]]), still):
        tiles = tiles.after((0.0, 0.0), reader(sums))
    assert tiles.same.all()


def reuse_of(frames: Iterable[NDArray[np.int64]]) -> list[bool]:
    """Whether tiles are reused in each frame with these fingerprints, of 8 x 8 tiles."""
    render = 8 * RENDER_TILE, 8 * RENDER_TILE
    display = (round(RATIO * render[0]), round(RATIO * render[1]))
    states, reused, tiles = [TileState(display), TileState(display)], [], StaticTiles.empty(render)
    for k, sums in enumerate(frames):
        tiles, jitter = tiles.after(halton_jitter(k, RATIO), reader(sums)), halton_jitter(k, RATIO)
        states[1].forget()
        states[1].follow(states[0], tiles, jitter)
        reused.append(states[1].active)
        states.reverse()
    return reused


def still_tiles(index: int, light: int = 1) -> NDArray[np.int64]:
    """Fingerprints of a scene in which nothing moves."""
    return np.full((8, 8), light * 100 + index % PERIOD + 1)


def test_reuse_is_given_up_soon_where_most_tiles_go_on_changing_until_fewer_do() -> None:
    ends = 4 * PERIOD + 3

    def frame(index: int) -> NDArray[np.int64]:
        sums = still_tiles(index)
        sums[:, 2 if index < ends else 6 :] = 1000 + index
        return sums

    reused = reuse_of(map(frame, range(8 * PERIOD)))
    given_up, resumed = reused.index(False), len(reused) - reused[::-1].index(False)
    assert PERIOD < given_up <= PERIOD + UNSTEADY_FRAMES + 2
    assert not any(reused[given_up:ends])
    # only one frame in LOOK_FRAMES is looked at, and what was not is compared a period later
    assert ends + PERIOD <= resumed <= ends + PERIOD + 2 * LOOK_FRAMES


def test_reuse_goes_on_when_the_light_of_a_resting_scene_changes_once() -> None:
    switched = 3 * PERIOD + 5
    assert all(reuse_of(still_tiles(k, 1 + (k >= switched)) for k in range(6 * PERIOD)))


def test_a_camera_that_stops_has_its_tiles_reused_from_its_first_frame() -> None:
    moving = np.full((8, 8), int(MOVING))
    reused = reuse_of(moving if k < 5 * PERIOD else still_tiles(k) for k in range(6 * PERIOD))
    assert not any(reused[2 : 5 * PERIOD])
    assert all(reused[5 * PERIOD :])
