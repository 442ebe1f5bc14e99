"""The backends, and half floats in torch, compute the same images as torch, over many frames."""

from collections.abc import Iterator

import pytest
import torch

from supersampler_bench import parity
from supersampler_bench.parity import ParityRecord, measure_parity


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Threads of torch that wait for each other wait long where other processes have the cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def test_methods_stay_with_torch_on_either_backend_of_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """`tests/gpu/test_gpu_parity.py` compares the GPU backend."""
    monkeypatch.setattr(parity, "RUNS", [runs for runs in parity.RUNS if runs[0] != "gpu"])
    monkeypatch.setattr(parity, "SIZES", (((80, 45), (160, 90)), ((53, 31), (80, 46))))
    results = measure_parity(["taau", "classifier"], 6)
    assert [(r.method, r.runs) for r in results][:6] == [
        ("taau", "onnx, fp32"),
        ("taau", "cpu, fp32"),
        ("classifier", "torch, fp16"),
        ("classifier", "onnx, fp32"),
        ("classifier", "onnx, fp16"),
        ("classifier", "cpu, int8"),
    ]
    for result in results:
        precision = result.runs.split()[-1]
        half = 2e-4 if result.runs == "torch, fp16" else 1e-4  # others round little in half floats
        assert result.last < {"int8": 1.0 / 255.0, "fp16": half, "fp32": 1e-5}[precision], result
        assert result.psnr > {"int8": 45.0, "fp16": 65.0, "fp32": 80.0}[precision], result
    assert "cpu, int8" in ParityRecord(results).table()
