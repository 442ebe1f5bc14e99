"""`bench latency` times settings in turns beside `taa`, and lists only those that a method has."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from supersampler_bench.cli import app
from supersampler_bench.timing import latency
from supersampler_bench.timing.latency import frames_of, measure_latency


def test_settings_that_a_method_has_are_timed_beside_taa() -> None:
    results = measure_latency(["taau", "bilinear"], [(64, 36)], ["cpu", "onnx"], [1], steps=2)
    found = [(r.setting.method, r.setting.executor) for r in results]
    assert found == [("taa", "cpu"), ("taau", "cpu"), ("taau", "onnx"), ("bilinear", "onnx")]
    assert results[0].multiple == 1.0
    for result in results:
        assert 0.0 < result.median <= result.p95 <= result.p99
        assert result.processor > 0.0
        assert result.first > result.median


def test_slow_settings_take_no_turns_with_fast_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[str] = []
    step = latency._LatencyRunner.step

    def noted(runner: latency._LatencyRunner, *, counts: bool = True) -> float:
        if counts:
            steps.append(runner.setting.method)
        return step(runner, counts=counts) * (1e3 if runner.setting.method == "taau" else 1.0)

    monkeypatch.setattr(latency._LatencyRunner, "step", noted)
    measure_latency(["taau", "bilinear"], [(64, 36)], ["onnx"], [1], steps=2)
    assert steps == ["taa", "bilinear"] * 2 + ["taau"] * 2


def test_frames_of_any_size_show_the_shipped_shot() -> None:
    large, small = frames_of((700, 400)), frames_of((33, 20))
    assert large[0].size == (700, 400)
    assert small[0].size == (33, 20)
    np.testing.assert_array_equal(large[3].depth[:20, :33], small[3].depth)
    np.testing.assert_array_equal(large[3].motion[180:200, 320:350], large[3].motion[:20, :30])


def test_the_command_writes_a_record_and_a_table(tmp_path: Path) -> None:
    arguments = ["latency", "--methods", "taa", "--display-size", "32x18", "--threads", "1", "--steps", "1"]
    result = CliRunner().invoke(app, [*arguments, "--json", str(tmp_path / "latency.json")])
    assert result.exit_code == 0, result.output
    assert "| 32x18 | 1 | taa | cpu, fp32 |" in result.output
    assert '"processor"' in (tmp_path / "latency.json").read_text()
