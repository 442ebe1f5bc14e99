"""`bench traffic` of the GPU backend, and the times computed for named GPUs."""

import pytest

from gpu_steps import device_or_skip, model
from supersampler.backends.gpu.program import TEXTURES
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler_bench.specs import Spec, parse_spec
from supersampler_bench.timing.gpu_traffic import accesses, count_gpu, part_of, pass_costs, products_of
from supersampler_bench.timing.traffic import GpuFigures, SizeTraffic, Traffic, TrafficRecord, min_ms

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
    gpu = GpuFigures("test", bandwidth=500.0, multiply_adds=10.0)
    assert min_ms(gpu, 1_000_000_000, 0) == pytest.approx(2.0)
    assert min_ms(gpu, 0, 120_000_000_000) == pytest.approx(3.0)
    assert min_ms(gpu, 1_000_000_000, 120_000_000_000) == pytest.approx(3.0)
    assert min_ms(gpu._replace(dot4=False), 0, 120_000_000_000) == pytest.approx(12.0)


def test_the_table_of_named_gpus_says_that_it_is_computed() -> None:
    rows = [Traffic("onnx", "taa", 9, 0, 600), Traffic("gpu", "taa", 480_000_000, 0, 4)]
    text = TrafficRecord([SizeTraffic(RENDER, DISPLAY, rows)]).roofline_table()
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


@pytest.mark.parametrize("method", ["classifier", "classifier-large"])
def test_passes_declare_what_their_step_is_counted_to_move(method: str) -> None:
    device_or_skip()
    counted, passes = count_gpu(method, RENDER, DISPLAY), pass_costs(model(method).gpu, RENDER, DISPLAY)
    assert sum(one.moved for one in passes) == counted.bytes
    products = sum(one.multiply_adds for one in passes)
    assert counted.multiply_adds <= products <= 1.5 * counted.multiply_adds, "channels fill up chunks"
    named = [one.name for one in passes if one.multiply_adds]
    assert named == ["encode_inputs 0", *(f"encode_pooled {level}" for level in (1, 2, 3)), "compose"]


def test_the_multiply_adds_of_a_pass_are_those_of_its_layers() -> None:
    level = {"level": 1, "inputs": 2, "channels": 3, "kept": 2, "pooled": 1}
    assert products_of(level) == 48 * 32 + 48 * 9 + 48 * 48
    assert products_of({"decoder": 0, "quads": 4}) == (32 * 32 + 64 * (32 + 64) + 4 * 16 * 64) / 4
    assert products_of({"alpha": 0.1}) == 0


@pytest.mark.parametrize("text", ["taau:gpu", "classifier:gpu"])
def test_a_method_is_asked_to_run_on_the_gpu_by_its_suffix(text: str) -> None:
    spec = parse_spec(text)
    assert spec == Spec(text.removesuffix(":gpu"), executor="gpu")
    assert str(spec) == text
