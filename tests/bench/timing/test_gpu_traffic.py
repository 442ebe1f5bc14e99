"""`bench traffic` and `bench device` of the GPU backend, and the times computed for named GPUs."""

import pytest

from gpu_steps import device_or_skip, model
from supersampler.backends.gpu.program import TEXTURES
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler_bench.specs import Spec, parse_spec
from supersampler_bench.timing.device_gpu import measure_gpu
from supersampler_bench.timing.gpu_traffic import accesses, count_gpu, part_of
from supersampler_bench.timing.roofline import Gpu, least_ms, roofline_table
from supersampler_bench.timing.traffic import Traffic, traffic_record

RENDER, DISPLAY = (64, 36), (128, 72)
CODE = """
@group(0) @binding(0) var<storage, read> near: array<f32>;   // 4 a thread
@group(0) @binding(1) var<storage, read> whole: array<f32>;
"""
SHADER = Shader(
    "test", CODE, tuple(Binding(0, i, n, "read-only-storage") for i, n in enumerate(["near", "whole"]))
)


def test_a_declared_part_is_pixels_of_sixteen_bytes_a_thread() -> None:
    near, whole = SHADER.bindings
    assert part_of(SHADER, near, 100) == 4 * 16 * 100
    assert part_of(SHADER, whole, 100) is None


def test_a_step_is_bound_by_bandwidth_or_by_arithmetic_whichever_takes_longer() -> None:
    gpu = Gpu("test", bandwidth=500.0, multiply_adds=10.0)
    assert least_ms(gpu, 1_000_000_000, 0) == pytest.approx(2.0)
    assert least_ms(gpu, 0, 120_000_000_000) == pytest.approx(3.0)
    assert least_ms(gpu, 1_000_000_000, 120_000_000_000) == pytest.approx(3.0)
    assert least_ms(gpu._replace(dot4=False), 0, 120_000_000_000) == pytest.approx(12.0)


def test_the_table_of_named_gpus_says_that_it_is_computed() -> None:
    rows = [Traffic("onnx", "taa", 9, 0, 600), Traffic("gpu", "taa", 480_000_000, 0, 4)]
    text = roofline_table(traffic_record([(RENDER, DISPLAY, rows)]))
    assert "| NVIDIA H200 | 0.10 |" in text
    assert "Computed, not measured" in text


def test_the_traffic_of_taa_is_that_of_its_textures() -> None:
    device_or_skip()
    render, display = (w * h for w, h in (RENDER, DISPLAY))
    moved = {
        (access.shader, access.resource): access.bytes
        for access in accesses(model("taa").gpu, RENDER, DISPLAY, TEXTURES)
    }
    assert moved["measure", "frame_color"] == moved["boxes", "frame_color"] == 8 * render
    assert moved["boxes", "tones"] == moved["blend", "tones"] == 16 * render
    assert moved["blend", "history_pixels"] == moved["blend", "next_pixels"] == 16 * display
    assert moved["blend", "image"] == 8 * display
    counted = count_gpu("taa", RENDER, DISPLAY)
    assert (counted.bytes, counted.multiply_adds, counted.dispatches) == (sum(moved.values()), 0, 4)


def test_steps_are_timed_by_the_devices_clock_and_methods_without_shaders_are_named() -> None:
    device_or_skip()
    notes: list[str] = []
    timed = measure_gpu(["taa", "bilinear"], [DISPLAY], steps=3, on_left_out=notes.append)
    assert [(one.method, one.display) for one in timed] == [("taa", DISPLAY)]
    assert 0.0 < timed[0].median <= timed[0].p95 <= timed[0].p99
    assert len(notes) == 1
    assert "bilinear" in notes[0]


@pytest.mark.parametrize("text", ["taau:gpu", "classifier:gpu"])
def test_a_method_is_asked_to_run_on_the_gpu_by_its_suffix(text: str) -> None:
    spec = parse_spec(text)
    assert spec == Spec(text.removesuffix(":gpu"), executor="gpu")
    assert str(spec) == text
