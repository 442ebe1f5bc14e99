"""Time against error of unshaded frames."""

from dataclasses import asdict
from typing import Any

import pytest

from supersampler_bench.record import setting
from supersampler_bench.report.doc_tables import blocks_of
from supersampler_bench.timing.pareto import pareto_record
from supersampler_bench.timing.pareto_extrapolated import (
    measure_unshaded,
    unshaded_points_of,
    unshaded_table,
)


def extrapolation(*, means: bool = True) -> dict[str, Any]:
    def scored(method: str, psnr: float) -> dict[str, Any]:
        scores = {"psnr": psnr, "ssim": 0.9, "flip": 0.1, "tpsnr": 27.0, "strred": None}
        return {"method": method, "summary": {"warm_cropped": scores}}

    ways = [("shaded", 30.0), ("warp", 26.0), ("warp, filled", 26.5), ("guided-warp", 29.0)]
    methods = [scored(f"{name}, {way}", psnr) for name in ("taau", "taa:off") for way, psnr in ways]
    alternations = [{"alternation": text, "methods": methods} for text in ("1:1", "2:1")]
    shot = {"name": "own", "render_size": [40, 30], "display_size": [60, 45], "alternations": alternations}
    record = {"bench": "extrapolation", "models": ["guided-warp"], "shots": [shot], "means": []}
    return {**record, "means": [{"ratio": 2.0, **a} for a in alternations]} if means else record


@pytest.mark.parametrize("means", [True, False])
def test_only_what_renders_every_second_frame_has_a_time(means: bool) -> None:
    found = list(unshaded_points_of(extrapolation(means=means)))
    assert [(h.upscaler, h.model) for h in found] == [("taau", "guided-warp"), ("taa:off", "guided-warp")]
    assert {h.ratio for h in found} == {2.0 if means else 1.5}
    assert found[0].scores["psnr"] == 29.0
    assert found[0].shaded_psnr == 30.0


def test_both_kinds_of_frames_are_timed_shown_and_come_back_from_their_record() -> None:
    measured = measure_unshaded([extrapolation(), {"bench": "quality"}], (48, 27), threads=1, steps=1)
    assert [h.unshaded for h in measured] == sorted(h.unshaded for h in measured)
    assert all(h.shaded > 0.0 and h.unshaded > 0.0 for h in measured)
    record = {**pareto_record([], ["a"], (48, 27), 1, measured), **setting()}
    assert list(unshaded_points_of(record)) == measured
    table = unshaded_table(record)
    assert "| 2 | taau | guided-warp | " in table
    assert "| 30.00 | 29.00 | 0.9000 | " in table
    assert blocks_of("pareto", record)["pareto unshaded"]() == table


def test_of_scores_that_several_records_have_the_last_are_timed_once() -> None:
    before: dict[str, Any] = {
        "bench": "pareto",
        "unshaded": [asdict(point) for point in unshaded_points_of(extrapolation())],
    }
    before["unshaded"][0]["scores"]["psnr"] = 20.0
    measured = measure_unshaded([before, extrapolation()], (48, 27), threads=1, steps=1)
    assert sorted((h.upscaler, h.scores["psnr"]) for h in measured) == [("taa:off", 29.0), ("taau", 29.0)]


def test_a_record_in_which_every_frame_was_shaded_has_no_table() -> None:
    assert unshaded_table({**pareto_record([], ["a"], (48, 27), 1), **setting()}) == ""
