"""Tests of ColorVideoVDP: what its package is given, and where its score is shown."""

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from checker_shot import write_checker_shot
from supersampler_bench.quality.color_video_vdp import Clip
from supersampler_bench.quality.score_table import QualityRecord
from supersampler_bench.record import read_record
from upscale_runs import run

SHOWN = np.linspace(0.0, 1.0, 4 * 6 * 3, dtype=np.float32).reshape(4, 6, 3)


class Metric:
    """A metric that returns 10 minus the mean difference of the bytes, and keeps what it was given."""

    def __init__(self, **options: Any) -> None:
        self.options = options

    def predict(self, test: NDArray[Any], reference: NDArray[Any], **given: Any) -> tuple[float, None]:
        assert test.dtype == reference.dtype == np.uint8
        calls.append((test.shape, self.options["display_name"], given))
        return 10.0 - np.abs(test.astype(float) - reference).mean(), None


calls: list[Any] = []


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a module in place of the package."""
    calls.clear()
    module = ModuleType("pycvvdp")
    vars(module)["cvvdp"] = Metric
    monkeypatch.setitem(sys.modules, "pycvvdp", module)


@pytest.mark.usefixtures("package")
def test_runs_of_consecutive_frames_are_clips_and_count_by_their_length() -> None:
    clip = Clip(24.0)
    for frame, error in ((8, 0.0), (9, 0.0), (10, 0.0), (12, 0.1)):
        clip.add(frame, np.full_like(SHOWN, 0.5 + error), np.full_like(SHOWN, 0.5))
    given = {"dim_order": "FHWC", "frames_per_second": 24.0}
    assert clip.jod() == pytest.approx((3 * 10 + (10 - 25)) / 4)
    assert calls == [((3, 4, 6, 3), "standard_fhd", given), ((1, 4, 6, 3), "standard_fhd", given)]
    assert np.isnan(Clip(None).jod())


@pytest.mark.usefixtures("package")
def test_the_score_is_of_frames_after_the_warm_up_without_the_border(tmp_path: Path) -> None:
    shot, values = write_checker_shot(tmp_path / "shot", 11), tmp_path / "values.json"
    command = ["bench", "quality", str(shot), "--methods", "bilinear", "--json", str(values)]
    answer = run(*command, "--cvvdp")
    assert answer.exit_code == 0, answer.output
    assert calls == [((3, 44, 64, 3), "standard_fhd", {"dim_order": "FHWC", "frames_per_second": 30.0})]
    record = QualityRecord.from_json(read_record(values))
    jod = record.shots[0].methods[0].known()["jod"]
    assert re.search(rf"ColorVideoVDP JOD ↑ +│ +{jod:.2f} │", answer.stdout)
    assert record.tables("quality own")["quality own clip"].count("JOD") == 1  # of the first of two tables
    assert "JOD" not in run(*command).stdout


def test_a_torchvision_of_another_torch_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "pycvvdp.py").write_text("raise RuntimeError('operator torchvision::nms does not exist')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "pycvvdp", raising=False)
    answer = run("bench", "quality", "plaza", "--cvvdp")
    assert answer.exit_code == 2
    assert "torchvision is not usable (operator torchvision::nms does not exist)" in answer.stderr
