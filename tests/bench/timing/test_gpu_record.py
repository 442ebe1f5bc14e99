"""`bench device`: what is timed and recorded, and its tables."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from apart import run_apart
from gpu_steps import device_or_skip
from supersampler_bench.report.doc_tables import block_text, blocks_of
from supersampler_bench.timing import gpu_limits, gpu_steps
from supersampler_bench.timing.gpu_limits import GpuLimits, measure_limits
from supersampler_bench.timing.gpu_record import GpuRecord
from supersampler_bench.timing.gpu_stopwatch import Stopwatch, device_with_timestamps
from supersampler_bench.timing.other_runtimes import RuntimeStep, measure_other_runtimes
from upscale_runs import run, succeeded

DISPLAY = (128, 72)
LIMITS = GpuLimits(buffers=1e12, textures=2e12, multiplied=1e13)
PASSES = (
    gpu_steps.GpuPass("gather", 0.2, 0.3, 400_000_000, 0),
    gpu_steps.GpuPass("compose", 0.9, 1.0, 200_000_000, 4_000_000_000),
)
STEP = gpu_steps.GpuStep(
    "classifier", (960, 540), (1920, 1080), "int8", 300, 1.2, 1.3, 1.4, 20.0, 25.0, 3.0,
    (gpu_steps.GpuPass("measure", 0.01, 0.01, 0, 0), *PASSES),
)  # fmt: skip
ADAPTER = {"device": "Some GPU", "backend_type": "Vulkan", "description": "1.2.3"}
EMPTY = GpuRecord(ADAPTER, {"wgpu": "0.32.0"}, LIMITS)
IMAGES = gpu_steps.GpuImages("classifier", (161, 91), (321, 181), 8, 4e-4, 8e-3, 6e-2)
ELSEWHERE = RuntimeStep("taau", "torch, compiled", "2.13.0", (960, 540), (1920, 1080), 50, 7.0, 8.0, 30.0)


@pytest.fixture(scope="module")
def device() -> Any:
    device_or_skip()
    return device_with_timestamps()


def record() -> GpuRecord:
    measured = replace(EMPTY, steps=[STEP, replace(STEP, display=(1440, 810))], images=[IMAGES])
    measured = replace(measured, others=[ELSEWHERE])
    return GpuRecord.from_json(json.loads(json.dumps(measured.to_json())))


def test_steps_are_timed_by_the_devices_clock_and_methods_without_shaders_are_named(device: Any) -> None:
    notes: list[str] = []
    timed = list(
        gpu_steps.measure_gpu(
            device, ["taa", "bilinear"], [DISPLAY], [2.0, 4.0], steps=3, on_left_out=notes.append
        )
    )
    assert [(one.method, one.render, one.display) for one in timed] == [
        ("taa", (64, 36), DISPLAY),
        ("taa", (32, 18), DISPLAY),
    ]
    for one in timed:
        assert one.steps == gpu_steps.BURST
        assert 0.0 < one.median <= one.p95 <= one.p99
        assert 0.0 < one.wall <= one.wall_p95
        assert [part.name for part in one.passes] == ["measure", "follow_frame", "blend"]
        assert all(0.0 <= part.median <= part.p95 for part in one.passes)
    assert len(notes) == 2
    assert "bilinear" in notes[0]


def test_a_stopwatch_counts_from_the_start_in_each_command_buffer(device: Any) -> None:
    watch = Stopwatch(device, 2)
    for pairs in (2, 1, 2):
        encoder = device.create_command_encoder()
        for _ in range(pairs):
            watch.around(encoder, lambda: None)
        times = watch.submit(encoder)
        assert times.shape == (pairs,)
        assert (times >= 0.0).all()


def test_throughput_of_a_device_is_measured(device: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gpu_limits, "RUNS", 2)
    limits = measure_limits(device, size=(4096, 16))
    assert min(limits.buffers, limits.textures, limits.multiplied) > 0.0


def test_the_floor_is_the_longer_time_of_the_faster_copy_and_of_the_products() -> None:
    assert LIMITS.floor_ms(2_000_000_000, 0) == pytest.approx(1.0)
    assert LIMITS.floor_ms(2_000_000_000, 20_000_000_000) == pytest.approx(2.0)


def test_images_are_compared_with_those_of_the_cpu_backend(device: Any) -> None:
    (found,) = gpu_steps.compare_images(device, ["taa"])
    assert found.mean < 1e-4
    assert found.mean < found.p999 < found.largest < 0.05


KIT = """
import sys
for name in ("torch", "onnx", "onnxruntime", "moderngl", "matplotlib", "flip_evaluator"):
    sys.modules[name] = None
from supersampler_bench.cli import timing
from supersampler_bench.timing import gpu_record, gpu_steps, other_runtimes
"""


def test_a_measuring_kit_needs_neither_torch_nor_onnx() -> None:
    run_apart(KIT)


def test_runtimes_without_a_gpu_are_left_out_with_the_reason() -> None:
    notes: list[str] = []
    found = list(measure_other_runtimes(["taau"], DISPLAY, 2.0, steps=1, on_left_out=notes.append))
    assert found or "CUDA" in notes[0]


def test_tables_have_steps_and_their_longest_passes() -> None:
    text = record().table()
    assert "| 960x540 to 1920x1080 | classifier | 1.20 | 1.30 | 0.60 | 4.0 | 0.40 | 3.0 | 20 | 3.0 |" in text
    assert "Some GPU, Vulkan, driver 1.2.3, wgpu 0.32.0. 300 steps" in text
    passes = record().passes_table()
    assert "| classifier | compose | 0.900 | 1.000 | 200 | 4.0 | 2.2 |" in passes
    assert "measure" not in passes, "less than 5 % of the step"
    assert passes.count("gather") == 1, "of the first size alone"
    assert "classifier 1.11 of 1.20" in passes
    assert "| classifier | 4.0e-04 | 8.0e-03 | 6.0e-02 |" in record().images_table()
    assert "| 960x540 to 1920x1080 | taau | torch, compiled | 7.00 | 8.00 | 30.0 |" in record().others_table()


def test_a_record_without_results_has_tables() -> None:
    assert all(EMPTY.tables("device").values())


def test_each_table_of_a_record_has_a_block() -> None:
    measured = record().to_json()
    blocks = blocks_of("device-some", measured)
    assert list(blocks) == [f"device some{table}" for table in ("", " passes", " images", " others")]
    assert block_text(measured, blocks["device some passes"]) == record().passes_table()


def test_the_command_records_what_it_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device_or_skip()
    monkeypatch.setattr(gpu_limits, "RUNS", 1)
    path = tmp_path / "device.json"
    options = ["--display-size", "128x72", "--ratio", "2", "--steps", "1", "--json", path]
    result = succeeded(run("bench", "device", "--methods", "taa", *options))
    found = json.loads(path.read_text("utf-8"))
    assert found["adapter"]["device"] in GpuRecord.from_json(found).table()
    assert all(table in result.output for table in GpuRecord.from_json(found).tables("device").values())
