"""`bench traffic`: counts from ONNX Runtime's profile, and exact at sizes that were not run."""

from fractions import Fraction

import onnx
import pytest

from supersampler import ArgumentError, ModelError
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.timing import traffic
from supersampler_bench.timing.traffic import (
    SizeTraffic,
    Traffic,
    TrafficRecord,
    count_onnx,
    small_extents,
)

SIZES = ((64, 36), (256, 144))


def test_the_count_at_a_size_is_that_of_a_run_at_this_size() -> None:
    render, display = (300, 190), (450, 285)
    info = read_model_info(find_model("taa"))
    counted = count_onnx("taa", render, display)
    assert (counted.bytes, counted.multiply_adds, counted.dispatches) == traffic._count_run(
        info, info.steps["fp32"], render, display
    )


def test_half_floats_are_counted_as_in_the_graph_without_the_casts_of_the_cpu_provider() -> None:
    info = read_model_info(find_model("classifier-small"))
    counts = [traffic._count_run(info, info.steps[kind], *SIZES) for kind in ("fp32", "fp16")]
    assert 0.6 < counts[1][0] / counts[0][0] < 0.85
    assert counts[1][1] == counts[0][1]
    nodes = onnx.load(info.steps["fp16"]).graph.node
    assert 0.95 * len(nodes) < counts[1][2] <= len(nodes)


def test_a_precision_without_a_graph_is_refused() -> None:
    with pytest.raises(ArgumentError, match="precision"):
        count_onnx("taau:fp16", *SIZES)


def test_a_model_of_one_ratio_is_counted_at_this_ratio_alone() -> None:
    with pytest.raises(ArgumentError, match=r"ratio is 4; want 2"):
        count_onnx("gbuffer-small", (64, 36), (256, 144))


def test_bytes_are_those_of_inputs_and_outputs_of_each_type() -> None:
    assert traffic._size_of({"float": [1, 3, 2, 2]}) == 48
    assert traffic._size_of({"bool": [5]}) == 5
    assert traffic._size_of({"int64": []}) == 8
    assert traffic._size_of({"float": [3]}, onnx.TensorProto.FLOAT16) == 6  # run in float32


def test_multiply_adds_are_outputs_times_the_numbers_summed_for_each() -> None:
    conv = traffic._multiply_adds(
        "Conv", [{"float": [1, 8, 4, 4]}, {"float": [6, 8, 3, 3]}], [{"float": [1, 6, 4, 4]}]
    )
    assert conv == 6 * 16 * 72
    transposed = traffic._multiply_adds("ConvTranspose", [{"float": [1, 8, 4, 4]}], [{"float": [1, 6, 8, 8]}])
    assert transposed == 8 * 16 * 24
    product = [{"float": [2, 3]}, {"float": [3, 5]}]
    assert traffic._multiply_adds("MatMul", product, [{"float": [2, 5]}]) == 30
    assert traffic._multiply_adds("Add", product, [{"float": [2, 5]}]) == 0


def test_a_cost_of_another_form_is_refused() -> None:
    assert traffic._bilinear([1, 3, 4, 7, 20], Fraction(10), Fraction(20)) == 281
    with pytest.raises(ModelError, match="not linear"):
        traffic._bilinear([1, 3, 4, 7, 21], Fraction(10), Fraction(20))


def test_small_extents_have_ratio_and_remainders_of_the_actual_ones() -> None:
    extents = small_extents(540, 810)
    for index in range(3):
        render, display = extents(index)
        assert (render * 3, render % 32, display % 32) == (display * 2, 540 % 32, 810 % 32)


def test_the_table_has_a_row_for_each_backend_method_and_size() -> None:
    row = Traffic("onnx", "taau", 75_049_000_000, 1_000_000, 1067)
    table = TrafficRecord([SizeTraffic(*SIZES, [row])]).table()
    assert "| 64x36 to 256x144 | taau | onnx | 75.05 | 0.0 | 1067 |" in table
