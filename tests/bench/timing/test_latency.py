"""`bench latency` times settings in turns beside `taa`, and lists only those that a method has."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gpu_steps import device_or_skip
from supersampler import ArgumentError
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.record import read_record
from supersampler_bench.timing import latency
from supersampler_bench.timing.latency import LatencyRecord, measure_latency, plaza_frames
from supersampler_bench.timing.skip import MOVES, SkipRecord, frame_count, measure_skipping
from supersampler_bench.timing.startup import FirstFrame, StartupRecord, measure_startup
from supersampler_bench.timing.traffic import CostRecord, cost_of, traffic_of
from supersampler_bench.timing.views import ViewsRecord, measure_views
from upscale_runs import refusal, run, succeeded


def test_settings_that_a_method_has_are_timed_beside_taa() -> None:
    results = measure_latency(["taau", "bilinear"], [(64, 36)], ["cpu", "onnx"], [1], steps=2)
    found = [(r.setting.method, r.setting.executor) for r in results]
    both = [(method, executor) for method in ("taau", "bilinear") for executor in ("cpu", "onnx")]
    assert found == [("taa", "cpu"), *both]
    assert results[0].multiple == 1.0
    for result in results:
        assert 0.0 < result.median <= result.p95 <= result.p99
        assert result.processor > 0.0
        assert result.first > 0.0
    summary = LatencyRecord(2.0, results).summary_table()
    assert [line.split(" | ")[0] for line in summary.splitlines()[2:7]] == [
        "| taa, cpu", "| taau, cpu", "| taau, onnx", "| bilinear, cpu", "| bilinear, onnx",
    ]  # fmt: skip
    assert " backend" not in summary
    of_one = LatencyRecord(2.0, [r for r in results if r.executor == "cpu"]).summary_table()
    assert "| taau | " in of_one
    assert ", cpu backend. " in of_one


def test_a_setting_that_a_method_lacks_is_named() -> None:
    notes: list[str] = []
    results = measure_latency(["gbuffer-small"], [(64, 36)], ["cpu"], [1], steps=1, on_left_out=notes.append)
    assert [r.setting.method for r in results] == ["taa"]
    assert notes[0].startswith("gbuffer-small on cpu is left out: ")


def test_slow_settings_do_not_alternate_with_fast_ones(monkeypatch: pytest.MonkeyPatch) -> None:
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
    large, small = plaza_frames((700, 400)), plaza_frames((33, 20))
    assert large[0].size == (700, 400)
    assert small[0].size == (33, 20)
    np.testing.assert_array_equal(large[3].depth[:20, :33], small[3].depth)
    np.testing.assert_array_equal(large[3].motion[180:200, 320:350], large[3].motion[:20, :30])


def test_the_command_writes_a_record_and_a_table(tmp_path: Path) -> None:
    arguments = ["latency", "--methods", "taa", "--display-size", "32x18", "--threads", "1", "--steps", "1"]
    result = succeeded(run("bench", *arguments, "--json", tmp_path / "latency.json"))
    assert "| 32x18 | 1 | taa | cpu, fp32 |" in result.output
    assert '"processor"' in (tmp_path / "latency.json").read_text()


@pytest.mark.parametrize(
    "command",
    [
        "latency --threads two", "latency --threads 0", "skip --scenes courtyard", "traffic --ratio 0",
        "traffic --ratio nan", "traffic --ratio 2,half",
    ],
)  # fmt: skip
def test_an_impossible_option_is_named(command: str) -> None:
    assert command.split()[1] in refusal("bench", *command.split())


RATIO = 1.0  # has the shortest jitter sequence, and so the fewest frames


@pytest.mark.long  # a period of the jitter
def test_a_scene_in_which_nothing_moves_is_frozen() -> None:
    frames = []
    results = measure_skipping(
        ["machine_hall"], ["taau"], (96, 64), ratio=RATIO, samples=4, on_frame=lambda: frames.append(1)
    )
    assert len(frames) == len(MOVES) * frame_count(RATIO)
    still, objects, camera = results
    assert [each.moves for each in results] == ["nothing", "objects", "camera"]
    assert still.converged == 1.0
    assert 1.0 > objects.converged >= camera.converged == 0.0
    assert still.psnr > camera.psnr
    table = SkipRecord((96, 64), RATIO, results, frame_count(RATIO)).table()
    assert f"| machine_hall | nothing | taau | {still.milliseconds:.1f} | {still.first:.2f} |" in table
    assert f"{frame_count(RATIO)} frames of test shots" in table


def test_several_cameras_are_timed_at_once_and_one_after_another(tmp_path: Path) -> None:
    arguments = ["views", "--methods", "taau", "--display-size", "32x18,40x40", "--count", "3"]
    arguments += ["--rounds", "2", "--json", str(tmp_path / "views.json")]
    succeeded(run("bench", *arguments))
    record = ViewsRecord.from_json(read_record(tmp_path / "views.json"))
    assert [times.display for times in record.results] == [(32, 18), (40, 40)]
    for times in record.results:
        assert min(times.one, times.each, times.at_once) > 0.0
        assert list(times.ratios) == sorted(times.ratios)
    assert "| 40x40 | taau |" in record.table()


def test_views_larger_than_the_shot_are_refused() -> None:
    with pytest.raises(ArgumentError, match="render size is 400x400; want at most 320x180"):
        measure_views(["taau"], [(800, 800)], views=1, threads=1)


# --- first-frame time with an empty and with a full kernel cache ---


@pytest.mark.long  # in new processes
def test_processes_with_an_empty_and_with_a_full_cache_are_timed() -> None:
    started: list[int] = []
    (result,) = measure_startup(["taa"], (64, 36), cold=1, warm=2, on_process=lambda: started.append(1))
    assert result.method == "taa"
    assert len(started) == 3
    assert result.cache_bytes == 0  # the CPU backend keeps none
    assert result.warm_seconds > 0.0
    assert result.cold_seconds > 0.0


@pytest.mark.long  # in new processes
def test_a_program_on_the_gpu_is_timed_from_its_start() -> None:
    device_or_skip()
    (result,) = measure_startup(["taa:gpu"], (64, 36), cold=1, warm=1)
    assert result.method == "taa:gpu"
    assert result.warm_seconds > 0.0


@pytest.mark.parametrize("method", ["no-such", "taa:int8"])  # taa has no network
def test_a_method_whose_process_fails_is_named(method: str) -> None:
    with pytest.raises(
        ArgumentError, match=f"--methods is {method}, whose process ended with code 1: .*Error"
    ):
        measure_startup([method], (64, 36), cold=1, warm=0)


def test_the_table_has_a_row_for_each_method() -> None:
    record = StartupRecord((480, 270), 2.0, [FirstFrame("taa", 2.04, 0.214, 4096)])
    table = record.table()
    assert "| taa | 2.0 | 0.21 | 4 |" in table
    assert "480x270" in table


def test_the_cost_of_a_folder_is_that_of_its_network(tmp_path: Path) -> None:
    folder = str(shutil.copytree(find_model("classifier-small"), tmp_path / "small"))
    cost = cost_of(folder)
    assert cost.multiply_adds == read_model_info(find_model("classifier-small")).multiply_adds
    assert cost.method == folder
    own, shipped = traffic_of([folder, "classifier-small"], (640, 360), [2.0])
    assert (own.method, replace(own, method=shipped.method)) == (folder, shipped)
    assert f"{cost.multiply_adds:,.0f}" in CostRecord([cost]).table()


def test_a_method_without_a_network_is_named() -> None:
    with pytest.raises(ArgumentError, match="taau"):
        cost_of("taau")
