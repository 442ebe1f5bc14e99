"""Tables that studies wrote into the documentation equal their records."""

from collections.abc import Callable
from pathlib import Path

import pytest

from studies import (
    ablation,
    blender_budget,
    both_ways,
    chunks,
    class_ceiling,
    gpu_accesses,
    integer_frames,
    long_shot,
    noise_model,
    older_processors,
    oracle,
    output_compression,
    path_tracing_noise,
    precision,
    preroll,
    pyvista_table,
    reactive_mask,
    returns,
    shaded_jitter,
    stage_breakdown,
    stepper_study,
    stochastic_alpha,
    thin_traces,
)
from studies import extrapolated_colors as colors
from supersampler_bench.markdown_blocks import find_block
from supersampler_bench.record import Record, read_record

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("page", "block", "record", "table"),
    [
        ("results/methods", "ablation classifier", "ablation-classifier", ablation.markdown_table),
        (
            "results/methods",
            "ablation classifier-small",
            "ablation-classifier-small",
            ablation.markdown_table,
        ),
        (
            "results/methods",
            "ablation gbuffer-small-4x",
            "ablation-gbuffer-small-4x",
            ablation.markdown_table,
        ),
        (
            "results/methods",
            "extrapolated colors test-shots",
            "extrapolated-colors",
            colors.markdown_table,
        ),
        ("results/methods", "stage breakdown", "stage-breakdown", stage_breakdown.markdown_table),
        ("results/backends", "precision", "precision", precision.markdown_table),
        ("results/backends", "latency avx-vnni", "latency-avx-vnni", older_processors.markdown_table),
        ("results/backends", "latency avx2", "latency-avx2", older_processors.markdown_table),
        ("quality", "oracle test-shots", "oracle", oracle.markdown_table),
        ("training", "returns", "returns", returns.markdown_table),
        ("shots", "integer-frames", "integer-frames", integer_frames.markdown_table),
        ("contract", "shaded-jitter", "shaded-jitter", shaded_jitter.markdown_table),
        ("quality", "thin-traces", "thin-traces", thin_traces.markdown_table),
        ("quality", "reactive-mask", "reactive-mask", reactive_mask.markdown_table),
        ("quality", "class-ceiling test-shots", "class-ceiling", class_ceiling.markdown_table),
        ("results/methods", "salvi-options test-shots", "salvi-options", stepper_study.markdown_table),
        ("results/methods", "stochastic-alpha", "stochastic-alpha", stochastic_alpha.markdown_table),
        ("results/methods", "missing-buffers test-shots", "missing-buffers", stepper_study.markdown_table),
        ("how-to/output-files", "output compression", "output-compression", output_compression.files_table),
        (
            "how-to/output-files",
            "display transforms",
            "output-compression",
            output_compression.transforms_table,
        ),
        ("tutorials/blender", "blender budget", "blender-budget", blender_budget.markdown_table),
        ("tutorials/shot", "path tracing noise", "path-tracing-noise", path_tracing_noise.markdown_table),
        ("training", "noise model", "noise-model", noise_model.markdown_table),
        ("explanation/gpu-backend", "gpu accesses", "gpu-accesses", gpu_accesses.accesses_table),
        ("how-to/farm", "preroll", "preroll", preroll.markdown_table),
        ("how-to/farm", "preroll at rest", "preroll", preroll.still_table),
        ("how-to/farm", "chunks", "chunks", chunks.markdown_table),
        ("how-to/upscale-sequences", "whole runs", "whole-runs", long_shot.markdown_table),
        ("how-to/upscale-both-ways", "both ways, motion", "both-ways-motion", both_ways.motion_table),
        ("tutorials/pyvista", "pyvista", "pyvista", pyvista_table.markdown_table),
    ],
)
def test_the_table_of_a_study_is_what_its_record_says(
    page: str, block: str, record: str, table: Callable[[Record], str]
) -> None:
    content, start, stop = find_block(ROOT / "docs" / f"{page}.md", f"study {block}")
    found = read_record(ROOT / "bench" / "results" / "studies" / f"{record}.json")
    assert content[start:stop].strip("\n") == table(found)
