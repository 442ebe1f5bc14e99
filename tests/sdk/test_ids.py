"""Ids at display size: never blended, as detailed as the image, independent of the backend."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Conventions, Frame, FrameError, RawFrame, Upscaler
from supersampler.arguments import ExecutorName
from supersampler.backends.cpu.ids import IdHistory
from supersampler.conventions.jitter import halton_jitter, jitter_phase_count
from supersampler.frame import Float32

RENDER, DISPLAY = (40, 30), (80, 60)
Ids = NDArray[np.integer[Any]]


def discs(x: Float32, y: Float32, time: float) -> tuple[Ids, Float32, Float32]:
    """Return ids (..., 2), depth and motion of two discs before a wall; the nearer one moves."""
    names = np.zeros((*x.shape, 2), np.int32)
    depth, motion = np.full(x.shape, 0.01, np.float32), np.zeros((*x.shape, 2), np.float32)
    still = (x - 24.0) ** 2 + (y - 18.0) ** 2 < 49.0
    names[still], depth[still] = (-5, 7), 0.02
    moving = (x - 10.0 - 0.37 * time) ** 2 + (y - 14.0) ** 2 < 20.0
    names[moving], depth[moving], motion[moving] = (2**31 - 1, 9), 0.05, (-0.37, 0.0)
    return names, depth, motion


def frame_at(index: int, *, moves: bool = True, render: tuple[int, int] = RENDER, **fields: Any) -> Frame:
    jitter, scale = halton_jitter(index, 2.0), np.float32(RENDER[0] / render[0])
    grid = np.mgrid[: render[1], : render[0]].astype(np.float32)
    x, y = (scale * (grid[1 - k] + np.float32(jitter[k] + 0.5)) - np.float32(0.5) for k in (0, 1))
    names, depth, motion = discs(x, y, index * moves)
    fields |= {"depth": depth, "motion": motion * moves, "jitter": jitter, "ids": names, "exposure": 1.0}
    return Frame(color=np.repeat(depth[..., None], 3, 2), **fields)


def truth_at(index: int, *, moves: bool = True) -> Ids:
    y, x = ((grid + 0.5) / 2 - 0.5 for grid in np.mgrid[: DISPLAY[1], : DISPLAY[0]].astype(np.float32))
    return discs(x, y, index * moves)[0]


def ids_of(upscaler: Upscaler, frame: Frame) -> Ids:
    result: Any = upscaler.step(frame, outputs=("ids",))
    return np.asarray(result.ids)


def defined(frame: Frame, display: tuple[int, int], history: IdHistory | None) -> IdHistory:
    """Compute ids as supersampler.h defines them, a pixel at a time."""
    assert frame.ids is not None
    (w, h), (width, height), f = frame.size, display, np.float32
    ids = frame.ids.astype(np.uint32)
    motions = np.where(np.isfinite(frame.motion), frame.motion, f(0))
    depth = np.where((frame.depth >= 0) & np.isfinite(frame.depth), frame.depth, f(-1))  # never the closest
    out = np.empty((height, width, ids.shape[2]), np.uint32)
    distances = np.empty((height, width), f)
    rx, ry = f(width) / f(w), f(height) / f(h)

    def nearest(pixel: int, ratio: np.float32, jitter: float, count: int) -> tuple[int, np.float32]:
        at = (f(pixel) + f(0.5)) / ratio - f(0.5) - f(jitter)
        sample = min(max(int(np.floor(at + f(0.5))), 0), count - 1)
        return sample, abs(at - f(sample)) * ratio

    for y in range(height):
        sy, down = nearest(y, ry, frame.jitter[1], h)
        for x in range(width):
            sx, across = nearest(x, rx, frame.jitter[0], w)
            found, distance = ids[sy, sx], max(across, down)
            own = motions[sy, sx] * (rx, ry)
            rows, columns = range(max(sy - 1, 0), min(sy + 2, h)), range(max(sx - 1, 0), min(sx + 2, w))
            around = [*product(rows, columns)]
            kept: list[tuple[np.float32, np.float32, int, int]] = []
            for j, i in around if history else ():
                assert history is not None
                motion = motions[j, i] * (rx, ry)
                ax, ay = f(x) + motion[0], f(y) + motion[1]
                nx, ny = np.floor(ax + f(0.5)), np.floor(ay + f(0.5))
                if 0 <= nx < width and 0 <= ny < height:
                    at = int(ny), int(nx)
                    if (history.ids[at] == ids[j, i]).all():
                        apart = history.distance[at] + max(abs(ax - nx), abs(ay - ny))
                        kept.append((-depth[j, i], apart + abs(motion - own).max(), j, i))
            if kept and any((ids[at] != ids[sy, sx]).any() for at in around):
                _, apart, j, i = min(kept)
                if apart < distance:
                    found, distance = ids[j, i], apart
            out[y, x], distances[y, x] = found, distance
    return IdHistory(out, distances)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_ids_are_as_defined_on_every_backend(executor: ExecutorName) -> None:
    upscaler = Upscaler(shared_model("taau", executor, threads=2), display_size=DISPLAY, validate="off")
    history = None
    for index in range(6):
        render = (33, 25) if index == 4 else RENDER
        frame = frame_at(index, render=render, reset=index == 3)
        for column, value in enumerate((np.nan, np.inf, 1e5, -1.0)):  # 1e5 pixels of motion are followed
            frame.motion[1::3, column::7, 0] = value
            frame.depth[::3, column::6] = value
        history = defined(frame, DISPLAY, None if index == 3 else history)
        got = ids_of(upscaler, frame)
        assert got.dtype == np.int32
        np.testing.assert_array_equal(got.astype(np.uint32), history.ids, err_msg=f"frame {index}")


def test_at_rest_ids_become_those_at_the_display_pixels_and_stay() -> None:
    upscaler, truth = Upscaler(shared_model("taau"), display_size=DISPLAY), truth_at(0, moves=False)
    wrong = []
    period = jitter_phase_count(2.0)
    for index in range(2 * period):
        got = ids_of(upscaler, frame_at(index, moves=False))
        wrong.append(int((got != truth).any(axis=2).sum()))
        if index >= period:
            assert wrong[-1] == wrong[period]
    assert wrong[-1] < wrong[0] / 4, wrong


def test_ids_of_what_moves_are_those_of_no_other_surface() -> None:
    upscaler = Upscaler(shared_model("taau"), display_size=DISPLAY)
    y, x = np.mgrid[:40, :40].astype(np.float32)
    known = {tuple(pair) for pair in discs(x, y, 0.0)[0].reshape(-1, 2).tolist()}
    errors, nearest = [], []
    for index in range(40):
        frame, truth = frame_at(index), truth_at(index)
        got = ids_of(upscaler, frame)
        assert {tuple(pair) for pair in got.reshape(-1, 2).tolist()} <= known
        errors.append((got != truth).any(axis=2).mean())
        alone = defined(frame, DISPLAY, None).ids.astype(np.int32)
        nearest.append((alone != truth).any(axis=2).mean())
    assert np.mean(errors[8:]) < 0.6 * np.mean(nearest[8:]), (np.mean(errors[8:]), np.mean(nearest[8:]))


@pytest.mark.parametrize("dtype", ["int8", "uint8", "int16", "uint16", "int32", "uint32"])
def test_ids_keep_their_type_and_all_their_values(dtype: str) -> None:
    limits = np.iinfo(dtype)
    random = np.random.default_rng(1)
    names = random.integers(limits.min, limits.max, (18, 32, 1), dtype, endpoint=True)
    upscaler = Upscaler(shared_model("bicubic"), display_size=(64, 36))
    got = ids_of(upscaler, noise(0, ids=names))
    assert got.dtype == dtype
    assert set(got.ravel()) <= set(names.ravel())
    assert got.shape == (36, 64, 1)


def test_a_state_holds_ids() -> None:
    one, other = (Upscaler(shared_model("taau"), display_size=DISPLAY) for _ in range(2))
    for index in range(5):
        ids_of(one, frame_at(index))
    other.load_state(one.save_state())
    for index in range(5, 8):
        np.testing.assert_array_equal(ids_of(one, frame_at(index)), ids_of(other, frame_at(index)))


def test_conventions_turn_ids_with_the_image() -> None:
    frame = frame_at(3)
    raw = RawFrame(depth=frame.depth, motion=frame.motion, ids=np.asarray(frame.ids)[::-1])
    turned = Conventions(bottom_up=True).converter().to_frame(raw)
    np.testing.assert_array_equal(np.asarray(turned.ids), frame.ids)


def test_wrong_ids_are_refused() -> None:
    frame = frame_at(0)
    ids: Any = frame.ids
    for wrong, message in (
        (ids.astype(np.float32), r"ids is \(30, 40, 2\) float32; .*int32.*view\(np.uint32\)"),
        (ids.astype(np.int64), r"ids is \(30, 40, 2\) int64; .*astype\(np.int32\)"),
        (ids.astype(np.int64) + 2**40, "int64; .*more than 32 bits"),
        (ids[..., 0], r"ids is \(30, 40\) int32; want \(30, 40, k\)"),
    ):
        with pytest.raises(FrameError, match=message):
            replace(frame, ids=wrong)
    upscaler = Upscaler(shared_model("taau"), display_size=DISPLAY)
    with pytest.raises(FrameError, match=r"ids is None; want .* because ids are requested"):
        ids_of(upscaler, replace(frame, ids=None))
    ids_of(upscaler, frame)
    with pytest.raises(FrameError, match="ids is 1 channels; want 2 channels as before, or a reset"):
        ids_of(upscaler, replace(frame, ids=ids[..., :1]))
    with pytest.raises(ArgumentError, match="outputs"):
        upscaler.step(frame, outputs=("id",))
