"""Bytes and multiply-adds of the passes of the GPU backend."""

import pytest

from supersampler.backends.gpu.program import TEXTURES, GpuProgram, PassSpec
from supersampler.backends.gpu.shader import Binding, Shader
from supersampler.methods.executors import gpu_program
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.timing.traffic import (
    TrafficRecord,
    pass_costs,
    products_of,
    touched_fraction,
    traffic_of,
)

RENDER, DISPLAY = (64, 36), (128, 72)
CODE = """
@group(0) @binding(0) var<storage, read> signatures: array<f32>;   // of 2 phases
@group(0) @binding(1) var<storage, read> whole: array<f32>;
@group(0) @binding(2) var<storage, read> mean: array<f32>;
"""
NAMES = "signatures", "whole", "mean"
SHADER = Shader("test", CODE, tuple(Binding(0, i, n, "read-only-storage") for i, n in enumerate(NAMES)))


def program_of(method: str) -> GpuProgram:
    program = gpu_program(read_model_info(find_model(method)))
    assert program is not None
    return program


def test_a_pass_accesses_the_phases_of_a_note_and_not_what_is_of_static_blocks() -> None:
    spec = PassSpec("test", static=("mean",), at_rest=("mean", "signatures"))
    moving, at_rest = (
        [touched_fraction(spec, SHADER, binding, 32, frozen=frozen) for binding in SHADER.bindings]
        for frozen in (False, True)
    )
    assert moving == [2 / 32, 1.0, 0.0]
    assert at_rest == [2 / 32, 0.0, 1.0]


def test_the_bytes_of_taa_are_those_of_its_textures() -> None:
    render, display = (w * h for w, h in (RENDER, DISPLAY))
    moved = {one.name: one.moved for one in pass_costs(program_of("taa"), RENDER, DISPLAY)}
    assert moved["measure"] >= 8 * render
    frame = (8 + 4) * render
    assert moved["blend"] == frame + 2 * 8 * display + 8 * display + 2 * 64, "history before and after, image"


@pytest.mark.parametrize("method", ["classifier", "classifier-large"])
def test_the_passes_of_the_network_have_its_multiply_adds(method: str) -> None:
    passes = pass_costs(program_of(method), RENDER, DISPLAY)
    counted = read_model_info(find_model(method)).multiply_adds * DISPLAY[0] * DISPLAY[1]
    products = sum(one.multiply_adds for one in passes)
    assert counted <= products <= 1.5 * counted, "channels fill up chunks"
    named = [one.name for one in passes if one.multiply_adds]
    assert named == ["encode_inputs 0", *(f"encode_pooled {level}" for level in (1, 2, 3)), "compose"]


def test_the_multiply_adds_of_a_pass_are_those_of_its_layers() -> None:
    level = {"level": 1, "inputs": 2, "channels": 3, "kept": 2, "pooled": 1}
    assert products_of(level) == 48 * 32 + 48 * 9 + 48 * 48
    assert products_of({"decoder": 0, "quads": 4}) == (32 * 32 + 64 * (32 + 64) + 4 * 16 * 64) / 4
    assert products_of({"alpha": 0.1}) == 0


MOST = {"taa": 0.25, "taau": 0.49, "classifier": 1.25}
"""Maximum gigabytes of a step from 1920x1080 to 3840x2160. Other upscalers move 0.58 to 0.84."""


MOST_AT_REST = {"taau": 0.285, "classifier": 0.285}
"""Maximum gigabytes of a frozen step: the frame, the mean and the image."""


@pytest.mark.parametrize("method", MOST_AT_REST)
def test_a_frozen_step_to_4k_moves_the_frame_the_mean_and_the_image(method: str) -> None:
    (step,) = traffic_of([method], (3840, 2160), [2.0])
    assert step.moved_at_rest <= 1e9 * MOST_AT_REST[method]
    costs = pass_costs(program_of(method), (1920, 1080), (3840, 2160), frozen=True)
    assert sum(one.multiply_adds for one in costs) == 0


def test_ratios_that_a_method_does_not_support_are_not_counted_and_named() -> None:
    notes: list[str] = []
    steps = traffic_of(["classifier-large", "taau"], (3840, 2160), [2.0, 4.0], on_left_out=notes.append)
    assert [(step.method, step.render[0]) for step in steps] == [
        ("classifier-large", 1920), ("taau", 1920), ("taau", 960),
    ]  # fmt: skip
    assert notes[0].startswith("classifier-large is left out: frame.size is (960, 540)")


def test_variables_that_a_frozen_step_accesses_are_declared() -> None:
    for method in ("taau", "classifier", "classifier-large", "gbuffer-fast"):
        program = program_of(method)
        shaders = [program.shader(spec, TEXTURES) for spec in program.passes]
        declared = {binding.name for shader in shaders for binding in shader.bindings}
        assert declared >= {name for spec in program.passes for name in spec.at_rest or ()}


@pytest.mark.parametrize("method", MOST)
def test_a_step_to_4k_moves_no_more_than_its_limit(method: str) -> None:
    (step,) = traffic_of([method], (3840, 2160), [2.0])
    assert step.moved <= 1e9 * MOST[method]
    assert step.passes <= 12
    assert f"| {method} | 1920x1080 to 3840x2160 |" in TrafficRecord([step]).table()
