"""Time against error: the frontier, the presets that follow, and the best setting within a time budget."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supersampler import ArgumentError, Upscaler
from supersampler.upscaler import PRESETS
from supersampler_bench.quality.score_table import CLIP_COLUMNS, QualityRecord
from supersampler_bench.quality.scores import MethodRow, ShotRow
from supersampler_bench.record import SHIPPED_PARETO, read_record
from supersampler_bench.report.figures import draw_pareto
from supersampler_bench.specs import Spec, parse_spec
from supersampler_bench.timing import latency, pareto
from supersampler_bench.timing.pareto import (
    ParetoPoint,
    ParetoRecord,
    at_ratio,
    best_within,
    frontier,
    measure_pareto,
    presets,
    scores_of,
    shot_names,
)
from supersampler_bench.timing.traffic import CostRecord

PSNR, FLIP = CLIP_COLUMNS[0], CLIP_COLUMNS[2]
SCORES = st.lists(st.tuples(st.floats(0.1, 100.0), st.floats(10.0, 50.0)), min_size=1, max_size=8)


def point(word: str, milliseconds: float, psnr: float, ratio: float = 2.0) -> ParetoPoint:
    scores = {"psnr": psnr, "flip": 1.0 / psnr}
    return ParetoPoint(word, "cpu, fp32", ratio, milliseconds, scores)


KNOWN = [
    point("bilinear", 9.0, 26.7),
    point("taa", 5.0, 26.8),
    point("taau", 8.0, 29.2),
    point("classifier-small", 13.0, 30.1),
    point("classifier:off", 15.5, 30.6),
    point("classifier", 16.0, 30.48),
    point("classifier:fp32", 380.0, 30.50),
]


@given(SCORES)
def test_frontier_points_are_undominated_and_others_are_dominated(found: list[tuple[float, float]]) -> None:
    points = [point(f"m{i}", *pair) for i, pair in enumerate(found)]
    for metric in (PSNR, FLIP):
        sign = 1.0 if metric.higher else -1.0
        line = frontier(points, metric)
        for p in points:
            beaten = any(
                q.milliseconds <= p.milliseconds
                and sign * (q.scores[metric.name] - p.scores[metric.name]) >= 0.0
                and q is not p
                for q in points
            )
            assert p in line or beaten
        times = [p.milliseconds for p in line]
        assert times == sorted(times)


def test_scores_of_a_pareto_record_can_be_timed_again() -> None:
    record = ParetoRecord(["a"], (96, 54), 2, KNOWN)
    scores = scores_of([record])[2.0]
    assert {str(spec): found["psnr"] for spec, found in scores.items()} == {
        p.spec: p.scores["psnr"] for p in KNOWN
    }


def test_presets_are_points_of_the_frontier_by_their_rule() -> None:
    chosen = presets(KNOWN)
    assert chosen == {"fast": "taau", "balanced": "classifier-small", "high": "classifier"}
    assert presets([*KNOWN, point("better", 100.0, 31.0)])["high"] == "better"
    assert presets([p for p in KNOWN if p.run.model != "classifier-small"])["balanced"] == chosen["high"]


@pytest.mark.parametrize(
    ("word", "spec"),
    [
        ("taau", Spec("taau")),
        ("classifier:fp32", Spec("classifier", "fp32")),
        ("classifier:int8:off", Spec("classifier", "int8", "off")),
        ("taau:accumulate", Spec("taau", at_rest="accumulate")),
        ("taau:gpu", Spec("taau", executor="gpu")),
        ("C:/models/mine", Spec("C:/models/mine")),
        ("classifier:fp32:x2", Spec("classifier", "fp32", passes=2)),
        ("C:/models/mine:fp16", Spec("C:/models/mine", "fp16")),
    ],
)
def test_settings_convert_to_text_and_back(word: str, spec: Spec) -> None:
    assert parse_spec(word, two_passes=True) == spec
    assert str(spec) == word


def test_two_passes_are_refused_where_frames_are_stepped_one_by_one() -> None:
    with pytest.raises(ArgumentError, match="method is 'taau:x2'; want a method of one pass"):
        parse_spec("taau:x2")


@pytest.mark.parametrize(
    ("text", "field"),
    [("classifier:fp32:int8", "precision"), ("taau:off:accumulate", "at_rest"), ("taau:x2:x2", "passes")],
)
def test_two_settings_of_one_kind_are_refused(text: str, field: str) -> None:
    with pytest.raises(ArgumentError, match=f"method is '{text}'; want one setting of its {field}"):
        parse_spec(text, two_passes=True)


def row(method: str, psnr: float, ratio: float | None = None) -> MethodRow:
    scores = {"psnr": psnr, "ssim": 0.9, "flip": 0.1, "tpsnr": 27.0, "strred": None}
    return MethodRow(method, {"warm_cropped": scores}, {}, ratio=ratio)


ROWS = [("bilinear", 26.0), ("taau", 29.0), ("classifier-small:off", 30.0)]


def shot(**rows: Any) -> ShotRow:
    return ShotRow("own", None, 1, [0], (40, 30), (60, 45), "depth and motion", **rows)


def quality(*more: str, ratio: float = 2.0, count: int = 3) -> QualityRecord:
    means = [row(*one, ratio) for one in (*ROWS[:count], *((name, 29.0) for name in more))]
    return QualityRecord([], means=means)


def test_settings_with_scores_are_timed_plotted_and_come_back_from_their_record(tmp_path: Path) -> None:
    points = measure_pareto([quality()], (48, 27), threads=1, steps=1)
    assert [p.spec for p in points] == ["bilinear", "taau", "classifier-small:off"]
    assert [p.runs for p in points] == ["cpu, fp32", "cpu, fp32", "cpu, int8"]
    assert all(p.milliseconds > 0.0 for p in points)
    record = ParetoRecord(["a", "b"], (48, 27), 1, points)
    table = record.table()
    assert "| **30.00** | " in table
    assert "STRRED" not in table
    written = draw_pareto(record, tmp_path)
    assert {path.name for path in written} >= {"pareto-psnr.png", "pareto-flip.png"}
    assert all(path.stat().st_size > 5000 for path in written)
    assert ParetoRecord.from_json(record.to_json()).points == points
    assert "mean scores of the test shots" in table
    assert "scores of a." in replace(record, shots=["a"]).table()
    assert "| fast | taau |" in record.presets_table()


def test_settings_are_timed_with_the_at_rest_that_they_were_scored_with(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    upscaler = Mock(side_effect=Upscaler)
    monkeypatch.setattr(latency, "Upscaler", upscaler)
    measure_pareto([quality("taau:off", count=2)], (48, 27), threads=1, steps=1)
    assert {call.kwargs["at_rest"] for call in upscaler.call_args_list} == {"converge", "off"}


def test_a_missing_model_folder_is_left_out_with_the_reason() -> None:
    record, reasons = quality("classifier-paper"), list[str]()
    points = measure_pareto([record], (48, 27), threads=1, steps=1, on_left_out=reasons.append)
    assert "classifier-paper" not in {p.run.model for p in points}
    [reason] = reasons
    assert reason.startswith("classifier-paper is left out: no model 'classifier-paper'")


def test_scores_of_one_shot_have_no_mean() -> None:
    record = QualityRecord([shot(methods=[row(*one) for one in ROWS])])
    [(ratio, scores)] = scores_of([record]).items()
    assert ratio == 1.5
    assert scores[Spec("taau")]["psnr"] == 29.0
    assert "strred" not in scores[Spec("taau")]
    assert shot_names(record) == ["own"]


def test_ratios_come_from_several_records_of_the_same_shots() -> None:
    other = quality(ratio=1.5, count=2)
    scores = scores_of([quality(), other])
    assert {ratio: len(group) for ratio, group in scores.items()} == {1.5: 2, 2.0: 3}
    with pytest.raises(ArgumentError, match="of the same shots"):
        scores_of([quality(), replace(other, shots=[shot()])])


def test_a_record_without_scores_is_refused() -> None:
    short = QualityRecord([shot(methods=[MethodRow("taau", {"warm_cropped": {"psnr": None}}, {})])])
    for record in (QualityRecord([]), short, CostRecord([])):
        with pytest.raises(ArgumentError, match="test-shots"):
            measure_pareto([quality(), record], (48, 27), threads=1)


def test_the_best_within_a_budget_is_followed_by_the_best_without_gbuffers() -> None:
    reads_gbuffers = point("gbuffer-small", 14.0, 31.0)
    best = best_within([*KNOWN, reads_gbuffers, point("taa", 3.0, 27.0, ratio=1.5)], 15.0)
    assert [p.spec for p in best] == ["taa", "gbuffer-small", "classifier-small"]
    assert best_within(KNOWN, 4.0) == []


def test_settings_of_two_passes_are_not_timed() -> None:
    points = measure_pareto([quality("taau:x2")], (48, 27), threads=1, steps=1)
    assert "taau:x2" not in [p.spec for p in points]
    assert "taau" in [p.spec for p in points]


def test_shipped_presets_are_chosen_by_their_rule() -> None:
    chosen = presets(at_ratio(ParetoRecord.from_json(read_record(SHIPPED_PARETO)).points, 2.0))
    specs = {name: parse_spec(text) for name, text in chosen.items()}
    shipped = {name: (p.model, p.precision) for name, p in PRESETS.items()}
    assert {name: (s.model, s.precision) for name, s in specs.items()} == shipped


def test_without_spatial_methods_or_points_there_are_no_presets() -> None:
    for points in ([p for p in KNOWN if p.run.model != "bilinear"], [point("bilinear:off", 9.0, 26.7)], []):
        assert ParetoRecord(["a"], (96, 54), 2, points).presets_table() == ""


def test_a_setting_on_the_gpu_is_timed_there(monkeypatch: pytest.MonkeyPatch) -> None:
    timed = Mock(return_value=[])
    monkeypatch.setattr(pareto, "measure_settings", timed)
    measure_pareto([quality("taau:gpu")], (48, 27), threads=1)
    assert [s.executor for s in timed.call_args.args[0] if s.method == "taau"] == ["auto", "gpu"]


def test_presets_leave_out_methods_that_lack_a_ratio() -> None:
    assert presets([*KNOWN, point("classifier-large", 30.0, 31.0)]) == presets(KNOWN)
