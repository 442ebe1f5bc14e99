"""Motion to the next frame: scattered, given, converted, imported, and checked."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plain_frames import complaints
from supersampler import Conventions, Frame, FrameError, RawFrame, Shot, halton_jitter
from supersampler.frame import Float32
from supersampler.io.shot import ShotWriter, import_blender
from supersampler.sequence.backward_motion import reversed_frame, scattered_motion
from supersampler.validation import detect_conventions
from supersampler_model.data.scenes.analytic import AnalyticScene, DiscOverPlane, Plane, zone_plate

SIZE = (128, 72)
UNIT = 2.0  # pixels of a unit of the analytic scenes
DISC = DiscOverPlane(velocity=(1.37, 0.71), background_velocity=(-0.45, 0.2), pattern=zone_plate)
HIDDEN, SAME_SURFACE, REACH = np.float32(1e30), 0.1, 4
"""Mismatch of a pixel that no sample reached; largest mismatch of one surface; pixels that are searched."""
RECORDED = Path(__file__).parents[1] / "blender" / "recorded"


def frame(scene: AnalyticScene, index: int, size: tuple[int, int] = SIZE) -> Frame:
    return replace(scene.frame(index, size, halton_jitter(index, 2.0)), exposure=1.0)


def truth(scene: DiscOverPlane, index: int) -> np.ndarray:
    """Motion to the next frame: of what moves evenly, minus the motion."""
    return -np.asarray(frame(scene, index).motion, np.float32)


def test_scattered_motion_is_that_of_each_surface() -> None:
    for index in range(4):
        found = scattered_motion(frame(DISC, index), frame(DISC, index + 1))
        off = np.abs(found - truth(DISC, index)).max(axis=2)
        inner = off[4:-4, 4:-4]
        assert np.median(inner) < 1e-4
        assert (inner > 0.1).mean() < 0.004  # of 9 % at the disc's edge


def test_a_surface_that_the_next_frame_hides_keeps_its_own_motion() -> None:
    """Pixels that the disc will cover have the background's motion, not the disc's."""
    now, after = frame(DISC, 0), frame(DISC, 1)
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5 + now.jitter[0], np.arange(SIZE[1]) + 0.5 + now.jitter[1])
    x, y = x / UNIT, y / UNIT
    moved = x + DISC.background_velocity[0], y + DISC.background_velocity[1]
    hidden = DISC.contains(1, *moved) & ~DISC.contains(0, x, y)
    assert hidden.sum() > 20
    off = np.abs(scattered_motion(now, after) - truth(DISC, 0)).max(axis=2)
    assert (off[hidden] > 0.1).mean() < 0.1


def mismatch_of(a: Float32, b: Float32) -> Float32:
    """Return the relative difference of two depths; HIDDEN where one is not finite."""
    with np.errstate(all="ignore"):
        off = np.abs(a - b) / np.maximum(np.maximum(np.abs(a), np.abs(b)), np.float32(1e-30))
    return np.where(off < HIDDEN, off, HIDDEN).astype(np.float32)


def scattered_in_numpy(now: Frame, after: Frame) -> Float32:
    """Return the scattered motion of two frames of one size; pixels that none reached take a near one's."""
    (width, height), motion = now.size, np.where(np.isfinite(after.motion), after.motion, 2e6)
    y, x = np.indices(after.depth.shape)
    shift = np.subtract(after.jitter, now.jitter)
    columns, rows = (np.floor(p + motion[..., k] + shift[k] + 0.5) for k, p in enumerate((x, y)))
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    to = rows[inside].astype(int) * width + columns[inside].astype(int)
    fit = mismatch_of(now.depth.ravel()[to], after.depth[inside])
    order = np.argsort(-fit, kind="stable")
    order = order[fit[order] <= SAME_SURFACE]  # the last one written is kept
    found, known = np.zeros((height * width, 2), np.float32), np.zeros(height * width, bool)
    found[to[order]], known[to[order]] = -motion[inside][order], True
    for row, column in zip(*np.nonzero(~known.reshape(height, width)), strict=True):
        top, left = max(row - REACH, 0), max(column - REACH, 0)
        box = slice(top, row + REACH + 1), slice(left, column + REACH + 1)
        dy, dx = np.indices(now.depth[box].shape)
        cost = (dy + top - row) ** 2 + (dx + left - column) ** 2
        cost += 1000 * (mismatch_of(now.depth[row, column], now.depth[box]) > SAME_SURFACE)
        near = np.where(known.reshape(height, width)[box], cost, 10**6)
        if near.min() < 10**6:
            found[row * width + column] = found.reshape(height, width, 2)[box].reshape(-1, 2)[near.argmin()]
    return found.reshape(height, width, 2)


def test_the_motion_is_what_numpy_scatters() -> None:
    now, after = frame(DISC, 2), frame(DISC, 3)
    after.motion[5, 7], after.depth[9, 3] = np.nan, np.inf
    found = scattered_motion(now, after)
    assert (np.abs(scattered_in_numpy(now, after) - found).max(axis=2) > 1e-4).mean() < 0.002
    assert np.isfinite(found).all()


def test_the_motion_is_in_pixels_of_its_own_frame_where_sizes_differ() -> None:
    small = frame(DISC, 1, (64, 36))
    off = np.abs(scattered_motion(frame(DISC, 0), small) - truth(DISC, 0)).max(axis=2)
    assert np.median(off) < 1e-4


def test_a_reversed_frame_has_the_motion_that_is_given() -> None:
    given = np.full((72, 128, 2), 0.3, np.float16)
    now = replace(frame(DISC, 0), motion_next=given)
    turned, last = reversed_frame(now, frame(DISC, 1)), reversed_frame(now, None)
    np.testing.assert_array_equal(turned.motion, given.astype(np.float32))
    assert (turned.reset, last.reset, bool(last.motion.any())) == (False, True, False)
    with pytest.raises(FrameError, match=r"frame.motion_next is \(72, 127, 2\) float16; want"):
        replace(now, motion_next=given[:, 1:])


def test_jitter_in_motion_next_is_refused_with_the_reason() -> None:
    raw = RawFrame(depth=np.ones((4, 8), np.float32), motion=np.zeros((4, 8, 2), np.float32),
                   motion_next=np.zeros((4, 8, 2), np.float32))  # fmt: skip
    with pytest.raises(FrameError, match="motion_next is given, with jitter in it"):
        Conventions(motion_jittered=True).converter().to_frame(raw)


def test_a_shot_keeps_motion_next_and_reads_it_on_demand(tmp_path: Path) -> None:
    given = truth(DISC, 0)
    with ShotWriter(tmp_path, name="s", display_size=None, frame_rate=24) as writer:
        writer.write(replace(frame(DISC, 0), motion_next=given))
        writer.write(frame(DISC, 1))
    first, second = (item.frame for item in Shot.open(tmp_path))
    np.testing.assert_array_equal(first.motion_next, given)
    assert second.motion_next is None
    assert next(iter(Shot.open(tmp_path).frames(gbuffers=()))).frame.motion_next is None
    (wanted, _) = (item.frame for item in Shot.open(tmp_path).frames(gbuffers=("motion_next",)))
    assert wanted.motion_next is not None


def test_blenders_vector_pass_leads_to_the_next_frame() -> None:
    """Recorded Z and W agree with the next frame's X and Y, and so does the scattered motion."""
    shown = [item.frame for item in import_blender(RECORDED)]
    for now, after in pairwise(shown):
        assert now.motion_next is not None
        off = np.abs(np.asarray(now.motion_next, np.float32) - scattered_motion(now, after)).max(axis=2)
        assert np.median(off) < 0.1  # they accelerate
        assert np.abs(now.motion_next).max() > 0.3


def test_vectors_of_eevee_to_the_next_frame_are_left_out() -> None:
    """They hold the next frame's jitter, which a frame does not know."""
    shot = import_blender(RECORDED, conventions=Conventions.blender(motion_jittered=True))
    assert next(iter(shot)).frame.motion_next is None
    assert detect_conventions(shot).notes is not None


@pytest.mark.parametrize(
    ("turned", "said"),
    [((1, 1), None), ((-1, -1), "current minus next"), ((1, -1), "y flipped"), ((0, 0), "inconsistent")],
)
def test_the_checks_find_motion_next_that_leads_elsewhere(turned: tuple[int, int], said: str | None) -> None:
    plain = [frame(Plane(zone_plate, velocity=(0.9, 0.7)), index) for index in range(3)]
    shown = [replace(one, motion_next=-one.motion * np.array(turned, np.float32)) for one in plain]
    told = complaints(*shown, validate="strict")
    raws: list[Any] = [Conventions().converter().from_frame(one) for one in shown]
    notes = " ".join(detect_conventions(raws).notes)
    assert ("motion_next is inconsistent" in told) == ("motion_next" in notes) == (said is not None)
    if said is not None:
        assert said in told
        assert said in notes
        assert "motion_next" in complaints(*shown)
