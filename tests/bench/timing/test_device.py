"""`bench device`: which settings are timed, and what its table shows."""

import pytest
from typer.testing import CliRunner

from supersampler.cli import app
from supersampler_bench.timing.device import (
    DeviceRecord,
    OnDevice,
    measure_copy,
    measure_device,
)


def test_each_precision_that_a_method_has_is_timed_with_and_without_recording() -> None:
    results = measure_device(
        ["taau", "classifier-small"],
        [(32, 18)],
        ["fp32", "fp16"],
        provider="cpu",
        steps=2,
        captures=(False, True),
    )
    assert [(r.method, r.precision, r.capture) for r in results] == [
        ("taau", "fp32", False),
        ("taau", "fp32", True),
        ("classifier-small", "fp32", False),
        ("classifier-small", "fp32", True),
        ("classifier-small", "fp16", False),
        ("classifier-small", "fp16", True),
    ]
    frame = 16 * 9 * 6 * 4  # colour, depth, motion
    assert all(r.moved > frame + 32 * 18 * 3 * 4 for r in results)
    assert all(0.0 < r.median <= r.p95 <= r.p99 for r in results)


def test_the_table_says_how_many_copies_long_a_step_is() -> None:
    sizes = (960, 540), (1920, 1080)
    timed = OnDevice("taau", *sizes, "fp32", "CUDAExecutionProvider", True, 2.0, 3.0, 4.0, 100_000_000)
    table = DeviceRecord([timed], 1e12).table()
    assert "| 960x540 to 1920x1080 | taau | fp32 | CUDAExecutionProvider | yes |" in table
    assert "| 2.00 | 3.00 | 4.00 | 100 | 20x |" in table
    assert "1000 GB/s" in table
    assert "| – |" in DeviceRecord([timed], 0.0).table()


def test_a_device_whose_copies_cannot_be_timed_has_no_limit() -> None:
    assert measure_copy("dml") == 0.0


@pytest.mark.parametrize("precisions", ["int8", "fp32,fp64"])
def test_graphs_have_no_other_precisions(precisions: str) -> None:
    result = CliRunner().invoke(app, ["bench", "device", "--precisions", precisions])
    assert result.exit_code != 0
    assert "want fp32, fp16, or some" in result.output


def test_torch_is_timed_on_cuda_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    result = CliRunner().invoke(app, ["bench", "device", "--executor", "torch", "--display-size", "32x18"])
    assert result.exit_code != 0
    assert "torch has no CUDA device" in result.output


@pytest.mark.parametrize(
    ("options", "want"), [(["--executor", "cpu"], "one of onnx, gpu, torch"), (["--ratio", "2,x"], "1.5,2")]
)
def test_unknown_options_are_refused_before_anything_is_timed(options: list[str], want: str) -> None:
    result = CliRunner().invoke(app, ["bench", "device", *options])
    assert result.exit_code != 0
    assert want in result.output
