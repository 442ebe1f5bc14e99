"""Providers of ONNX Runtime: which are chosen, also where it is not installed."""

import pytest

from supersampler.backends.onnx import runtime


def test_other_backends_need_no_onnx_runtime(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "find_spec", lambda _: None)
    monkeypatch.setattr(runtime, "_distribution", lambda: None)
    monkeypatch.setattr(runtime, "ort", None)
    assert runtime.resolve_providers("auto") == [runtime.CPU]
