"""Class counts and overlaps equal values worked out by hand."""

import numpy as np
import pytest

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.shot import ClassMaps
from supersampler_bench.quality.score_table import class_tables
from supersampler_bench.quality.scores import (
    FRAME_METRICS,
    ClassCounts,
    Counts,
    FrameScores,
    MethodRow,
    MethodScores,
    count_classes,
    fractions,
    overlap,
)

SCORES = dict.fromkeys(("srred", "trred", *FRAME_METRICS), float("nan"))


def class_map(ghost: list[list[int]], alias: list[list[int]]) -> Float32:
    """(h, w, 6) that says these classes of 2x2 pixels each, with a doubt."""
    probabilities = np.concatenate([np.eye(3)[np.array(predicted)] for predicted in (ghost, alias)], axis=-1)
    return (0.6 * probabilities + 0.1).astype(np.float32)


def truth(ghost: list[list[int]], alias: list[list[int]]) -> ClassMaps:
    return ClassMaps(np.array(ghost, np.uint8), np.array(alias, np.uint8))


def scores(counts: Counts | None, frame: int = 8) -> MethodScores:
    return MethodScores("m", [FrameScores(frame, SCORES, SCORES, counts, counts)])


def test_each_display_pixel_is_compared_with_the_class_of_its_2x2_pixels() -> None:
    true = truth([[0, 1, 2], [0, 1, 1], [2, 2, 0]], [[0] * 3, [1] * 3, [2] * 3])  # the squares are cut off
    predicted = class_map([[1, 2], [2, 0]], [[0, 0], [2, 1]])
    ghost, alias = count_classes(predicted, true)
    assert ghost.tolist() == [[1, 2, 0], [0, 2, 1], [0, 0, 3]]
    assert alias.tolist() == [[3, 0, 0], [3, 0, 0], [0, 1, 2]]
    assert count_classes(predicted, true, border=1).tolist() == [
        [[0, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 0, 0]],
    ]


def test_a_map_of_display_size_is_counted_pixel_by_pixel() -> None:
    labels = [[0, 1, 2], [0, 1, 1], [2, 2, 0]]
    true = truth(labels, [[0] * 3, [1] * 3, [2] * 3])
    ghost, alias = count_classes(class_map(labels, [[0] * 3, [1] * 3, [1] * 3]), true)
    assert ghost.tolist() == [[3, 0, 0], [0, 3, 0], [0, 0, 3]]
    assert alias.tolist() == [[3, 0, 0], [0, 3, 0], [0, 3, 0]]


def test_a_map_of_neither_size_is_refused() -> None:
    true = truth([[0] * 5] * 3, [[0] * 5] * 3)
    with pytest.raises(ArgumentError, match=r"class_map is of \(2, 2\) pixels; want \(2, 3\) or \(3, 5\)"):
        count_classes(class_map([[0, 0], [0, 0]], [[0, 0], [0, 0]]), true)


def test_overlap_is_intersection_over_union_and_nan_for_an_absent_class() -> None:
    matrix = np.array([[6, 2, 0], [1, 3, 0], [0, 0, 0]])
    np.testing.assert_allclose(overlap(matrix), [6 / 9, 3 / 6, np.nan])
    np.testing.assert_allclose(fractions(matrix)[:2], [[0.75, 0.25, 0], [0.25, 0.75, 0]])
    assert np.isnan(fractions(matrix)[2]).all()


def test_counts_add_up_over_frames_and_shots_as_summaries_count_them() -> None:
    one = np.ones((2, 3, 3), np.int64)
    late, early = scores(one), scores(one, frame=7)
    both = MethodScores("m", [*early.frames, *late.frames])
    everything = both.classes(warm=False, cropped=False)
    assert everything is not None
    assert everything.sum() == 2 * one.sum()
    mean = MethodRow.mean([MethodRow.of(s) for s in (both, late, scores(None))])
    of_all = mean.counts()
    assert of_all is not None
    assert of_all.sum() == 2 * one.sum()
    assert scores(None).classes() is None
    assert early.classes() is None


def test_the_tables_name_true_and_predicted_classes_and_overlap() -> None:
    counts = np.stack([np.diag([90, 10, 0]), np.array([[50, 25, 25], [0, 0, 0], [0, 0, 0]])])
    ghosting, aliasing = class_tables([MethodRow.of(scores(counts))]).split("\n\n")
    heading = (
        "| ghosting, `m` | predicted none | predicted visibility | predicted shading | of all pixels | IoU |"
    )
    assert ghosting.splitlines()[0] == heading
    assert ghosting.splitlines()[2] == "| none | 100.0 % | 0.0 % | 0.0 % | 90.00 % | 1.000 |"
    assert ghosting.splitlines()[4] == "| shading | – | – | – | 0.00 % | – |"
    assert aliasing.splitlines()[2] == "| none | 50.0 % | 25.0 % | 25.0 % | 100.00 % | 0.500 |"


def test_methods_without_classes_have_no_tables() -> None:
    assert class_tables([MethodRow.of(scores(None))]) == ""
    assert ClassCounts.of(None) is None


def test_a_record_has_counts_by_true_and_then_by_predicted_class() -> None:
    counts = np.arange(18).reshape(2, 3, 3)
    record = ClassCounts.of(counts)
    assert record is not None
    assert record["aliasing"].classes == ["none", "geometry", "texture"]
    assert record["ghosting"].pixels_by_true_and_predicted_class[0] == [0, 1, 2]
    assert record["ghosting"].intersection_over_union[2] == pytest.approx(8 / (21 + 15 - 8))
