"""Measures of corners on small planes whose results are known."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler.frame import Array, Float32
from supersampler.io.shot import Shot
from supersampler_bench.fsr1 import EASU
from supersampler_bench.quality import corners
from supersampler_bench.quality.corners import (
    KINDS,
    CornerTruth,
    CornerTruths,
    color_trail,
    kinds_of,
    near,
    speckle,
    specks,
    thin_kept,
    trail,
)
from supersampler_bench.quality.measure import measure_quality
from supersampler_bench.quality.score_table import NO_KINDS, QualityRecord
from supersampler_bench.quality.scores import shot_row
from supersampler_bench.shots.public_shots import CORNER_SHOTS
from supersampler_bench.shots.rendering import render_test_shot

SHAPE = (40, 60)
STILL = np.zeros((*SHAPE, 2), np.float32)
NOWHERE = np.zeros(SHAPE, bool)
WALL, WIRE = np.array([0.8, 0.7, 0.6], np.float32), np.array([0.1, 0.1, 0.2], np.float32)


def planes(**given: Array) -> dict[str, Array]:
    """Return the planes of truth; those not given are those of an empty, lit screen."""
    empty = {name: np.zeros(SHAPE, np.float16) for name in ("thin_still", "thin_moving", "moving")}
    return {**empty, "unshadowed": np.ones(SHAPE, np.float16), **given}


def column(*places: int, value: float = 1.0) -> Float32:
    """Return a plane with upright lines at these columns."""
    plane = np.zeros(SHAPE, np.float32)
    plane[:, list(places)] = value
    return plane


def after(*frames: dict[str, Array], motion: Array = STILL, ratio: float = 2.0) -> CornerTruth:
    truths = CornerTruths(ratio)
    for index, frame in enumerate(frames):
        truth = truths.next(frame, motion, NOWHERE, reset=index == 0)
    assert truth is not None
    return truth


def moving_wire(*places: int) -> CornerTruth:
    """Return the truth of a wire that was at these columns, one a frame, and is at the last one."""
    return after(*(planes(thin_moving=column(place)) for place in places))


def seen(coverage: Array) -> Float32:
    """Return the wall with so much of the wire in front."""
    return np.asarray(WALL + coverage[..., None] * (WIRE - WALL), np.float32)


def test_a_trail_is_the_coverage_beyond_four_pixels_over_the_true_coverage() -> None:
    truth = moving_wire(10, 30)
    assert trail(column(30), truth) == (0.0, SHAPE[0])
    assert trail(column(26, 34), truth).value == 0.0  # four pixels away: blur, no trail
    assert trail(column(25, value=0.5) + column(10, value=0.25), truth).value == pytest.approx(0.75)
    assert trail(column(5, value=1.0), truth, border=6) == (0.0, SHAPE[0] - 12)  # in the border


def test_a_trail_begins_two_render_pixels_from_an_object_at_any_ratio() -> None:
    frame = planes(thin_moving=column(30))
    assert trail(column(33), after(frame, ratio=1.5)).value == 0.0
    assert trail(column(33), after(frame, ratio=1.0)).value == 1.0


def test_coverage_beside_a_thin_object_at_rest_is_no_trail() -> None:
    truth = after(planes(thin_moving=column(30), thin_still=column(10)))
    assert trail(column(11), truth).value == 0.0


def test_without_thin_movers_there_is_no_trail_to_measure() -> None:
    truth = after(planes(thin_still=column(10)))
    assert np.isnan(trail(column(30), truth).value)
    assert trail(column(30), truth).weight == 0.0
    assert np.isnan(color_trail(seen(column(10)), seen(column(10)), truth).value)


def test_a_trail_in_colour_is_the_remaining_fraction_of_the_wire() -> None:
    truth = moving_wire(10, 20, 30)
    reference = seen(column(30))
    ghosts = seen(column(30) + column(20, value=0.3) + column(10, value=0.1))
    assert color_trail(ghosts, reference, truth).value == pytest.approx(0.4, abs=1e-6)
    assert color_trail(reference, reference, truth).value == 0.0
    lighter = seen(column(30) - column(20, value=0.3))
    assert color_trail(lighter, reference, truth).value == pytest.approx(-0.3, abs=1e-6)


def test_errors_everywhere_or_of_another_colour_are_no_trail_in_colour() -> None:
    truth, reference = moving_wire(10, 20, 30), seen(column(30))
    darker = reference + 0.2 * (WIRE - WALL)
    assert color_trail(darker, reference, truth).value == pytest.approx(0.0, abs=1e-5)
    across = np.cross(WIRE - WALL, [1.0, 0.0, 0.0])
    tinted = reference + column(20)[..., None] * across
    assert color_trail(tinted, reference, truth).value == pytest.approx(0.0, abs=1e-5)


def test_left_pixels_follow_the_motion_of_the_background_for_a_few_frames() -> None:
    to_the_left = np.full((*SHAPE, 2), (2.0, 0.0), np.float32)  # by two pixels a frame
    truth = after(*(planes(thin_moving=column(at)) for at in (20, 40)), motion=to_the_left)
    assert truth.left[:, 18].all()
    assert not truth.left[:, 20:36].any()
    long_ago = moving_wire(10, *([40] * (corners.REMEMBERED + 1)))
    assert not long_ago.left.any()
    assert moving_wire(10, *([40] * corners.REMEMBERED)).left[:, 10].all()


def test_a_cut_clears_the_positions_of_objects_and_shadows() -> None:
    truths = CornerTruths(2.0)
    truths.next(planes(thin_moving=column(10), unshadowed=column(50)), STILL, NOWHERE, reset=True)
    truth = truths.next(planes(thin_moving=column(30)), STILL, NOWHERE, reset=True)
    assert truth is not None
    assert not truth.left.any()
    assert not truth.shadow_edges.any()


def test_kept_coverage_counts_where_thin_objects_cover_more_than_three_tenths() -> None:
    truth = after(planes(thin_still=column(10, value=0.8), thin_moving=column(30, value=0.25)))
    kept = thin_kept(column(10, value=0.4) + column(30), truth)
    assert kept.value == pytest.approx(0.5)
    assert kept.weight == pytest.approx(0.8 * SHAPE[0])


def test_shadow_edges_are_two_pixels_around_where_a_shadow_came_or_went() -> None:
    lit = np.ones(SHAPE, np.float32)
    came = after(planes(unshadowed=lit), planes(unshadowed=lit - column(20)))
    went = after(planes(unshadowed=lit - column(20)), planes(unshadowed=lit))
    for truth in (came, went):
        assert np.flatnonzero(truth.shadow_edges.all(axis=0)).tolist() == [18, 19, 20, 21, 22]
    still = after(*[planes(unshadowed=lit - column(20))] * 2)
    assert not still.shadow_edges.any()


def test_a_shadow_at_rest_has_no_moving_edge_when_the_camera_moves_by_half_a_pixel() -> None:
    edge = np.repeat([[1.0] * 30 + [0.0] * 30], SHAPE[0], axis=0)
    half = 0.5 * (edge + np.roll(edge, 1, axis=1))  # half a pixel to the right
    whole = np.roll(edge, 1, axis=1)
    motion = np.full((*SHAPE, 2), (-0.5, 0.0), np.float32)
    for before, now in ((edge, half), (half, whole)):
        truth = after(planes(unshadowed=before), planes(unshadowed=now), motion=motion)
        assert not truth.shadow_edges[:, 5:-5].any()
    paler = after(*(planes(unshadowed=1.0 - column(20, value=value)) for value in (0.0, 0.35)))
    assert paler.shadow_edges[:, 20].all()


def test_light_that_changes_on_an_outline_is_no_shadow_edge() -> None:
    lit, ball = np.ones(SHAPE, np.float32), np.zeros(SHAPE, np.float32)
    ball[:, 20:] = 1.0
    frames = planes(unshadowed=lit), planes(unshadowed=lit - column(20), moving=ball)
    assert not after(*frames).shadow_edges.any()


EDGE = np.broadcast_to(np.where(np.arange(SHAPE[1]) < 30, 0.2, 0.7)[:, None], (*SHAPE, 3))
DOTTED = EDGE.copy()
DOTTED[20, 32] += 0.2
BLUR = np.array([[0.05], [0.2], [-0.15], [-0.02]])
BAND = 8 * SHAPE[0]
"""Pixels of columns 26 to 33, around the outline of a mover that covers the right half."""


@pytest.mark.parametrize(
    ("reference", "changes", "speckles"),
    [
        pytest.param(EDGE, [(np.s_[20, 32], 0.2)], 0.2 / BAND, id="a dot"),
        pytest.param(EDGE, [(np.s_[20:22, 31:33], 0.2)], 0.8 / BAND, id="a sample's pixel at ratio 2"),
        pytest.param(EDGE, [(np.s_[20, 40], 0.2)], 0.0, id="a dot far away"),
        pytest.param(EDGE, [(np.s_[:, 28:32], BLUR)], 0.0, id="blur"),
        pytest.param(DOTTED, [], 0.0, id="a dot of the reference"),
        pytest.param(
            DOTTED, [(np.s_[20, 32], -0.2), (np.s_[10, 32], 0.2)], 0.2 / BAND, id="a dot that moved"
        ),
    ],
)
def test_speckle_counts_dots_near_outlines_that_the_reference_lacks(
    reference: NDArray[np.float64], changes: list[tuple[Any, Any]], speckles: float
) -> None:
    truth, image = after(planes(moving=column(*range(30, SHAPE[1])))), reference.copy()
    for place, change in changes:
        image[place] += change
    found = speckle(specks(image, truth.window), specks(reference, truth.window), truth)
    assert found.value == pytest.approx(speckles, rel=0.01)


def test_the_window_of_specks_is_less_than_half_filled_by_a_sample() -> None:
    windows = {ratio: after(planes(), ratio=ratio).window for ratio in (1.0, 1.5, 2.0, 2.5, 3.0, 4.0)}
    assert windows == {1.0: 3, 1.5: 3, 2.0: 3, 2.5: 5, 3.0: 5, 4.0: 7}


def test_each_pixel_is_of_the_first_kind_that_applies() -> None:
    mover = np.zeros(SHAPE, np.float32)
    mover[:, 30:45] = 1.0
    lit = np.ones(SHAPE, np.float32)
    frames = planes(unshadowed=lit), planes(unshadowed=lit - column(20), moving=mover, thin_still=column(10))
    edges = column(5, 10, 37) > 0.0
    kinds = kinds_of(after(*frames), edges)
    assert list(kinds) == list(KINDS)
    assert (np.sum(list(kinds.values()), axis=0) == 1).all()
    first = {kind: np.flatnonzero(mask[20]).tolist() for kind, mask in kinds.items()}
    assert first["thin"] == [8, 9, 10, 11, 12]
    assert first["silhouette"] == [27, 28, 29, 30, 31, 32, 42, 43, 44, 45, 46, 47]
    assert first["shadow"] == [18, 19, 20, 21, 22]
    assert first["mover"] == list(range(33, 42))
    assert first["edge"] == [5]


def test_near_is_a_disc() -> None:
    point = np.zeros((9, 9), bool)
    point[4, 4] = True
    assert near(point, 2).sum() == 13
    assert near(point, 3)[4, 7]
    assert not near(point, 3)[6, 7]


def test_shots_without_planes_of_truth_have_no_corners() -> None:
    for known in ({}, {"moving": column(3)}):
        assert CornerTruths(2.0).next(known, STILL, NOWHERE, reset=True) is None


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Shot:
    cache: Path = tmp_path_factory.mktemp("cache")
    tiny = replace(CORNER_SHOTS, frames=10, display_size=(96, 54), ratios=(2.0,), samples=4)
    render_test_shot(cache, tiny, "thin_movers")
    return Shot.open(cache / "test-shots" / "thin_movers" / "2x.json")


def test_the_bench_measures_corners_of_a_shot_with_truth(shot: Shot) -> None:
    measured = measure_quality(shot, ["bilinear", EASU, "taau"])
    cuts = [item.index for item in shot if item.frame.reset]
    assert len(cuts) == 2
    for scores in measured:
        summary = scores.summary()
        assert summary["trail"] >= 0.0
        assert 0.1 < summary["thin_kept"] < 1.1
        assert summary["speckle"] >= 0.0
        assert summary["psnr_first"] == np.mean([scores.frames[cut].cropped["psnr"] for cut in cuts])
        assert sum(summary[f"error_share_{kind}"] for kind in KINDS) == pytest.approx(1.0)
        assert sum(summary[f"pixel_share_{kind}"] for kind in KINDS) == pytest.approx(1.0)
    assert measured[0].summary()["trail"] < 0.01
    record = QualityRecord.of([shot_row(shot, measured)])
    assert "thin coverage kept" in record.corners_table()
    assert "| of the pixels |" in record.kinds_table()
    unknown = [replace(row, summary={**row.summary, "warm_cropped": {}}) for row in record.shots[0].methods]
    assert QualityRecord.of([replace(record.shots[0], methods=unknown)]).kinds_table() == NO_KINDS
