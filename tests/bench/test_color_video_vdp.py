"""ColorVideoVDP through a package of its name that remembers what it was given."""

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

from supersampler import SupersamplerError
from supersampler.cli import app
from supersampler.frame import Float32
from supersampler.io.shot import Shot, ShotWriter
from supersampler_bench.color_video_vdp import Clips
from supersampler_bench.quality import measure_quality
from supersampler_model.data.scenes.analytic import Plane, checker


class Metric:
    """Ten, less a sixteenth of the mean difference in grey levels."""

    clips: ClassVar[list[tuple[Any, ...]]] = []

    def __init__(self, **settings: Any) -> None:
        assert settings == {"display_name": "standard_4k", "quiet": True}

    def predict(
        self, shown: Any, truth: Any, *, dim_order: str, frames_per_second: float
    ) -> tuple[float, None]:
        assert shown.dtype == np.uint8
        Metric.clips.append((shown.shape, dim_order, frames_per_second))
        return 10.0 - float(np.abs(shown.astype(float) - truth).mean()) / 16.0, None


@pytest.fixture
def package(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("pycvvdp")
    module.__spec__ = ModuleSpec("pycvvdp", None)
    module.cvvdp = Metric  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "pycvvdp", module)
    monkeypatch.setattr(Metric, "clips", [])


def grey(level: int) -> Float32:
    return np.full((20, 30, 3), level / 255.0, np.float32)


@pytest.mark.usefixtures("package")
def test_a_clip_is_judged_whole_at_its_frame_rate() -> None:
    clips = Clips(2, 24.0)
    for frame in range(4):
        clips.add(frame, grey(100), [grey(100), grey(100 + frame)])
    assert clips.score(0, 0, 0) == 10.0
    assert clips.score(1, 0, 0) == 10.0 - 1.5 / 16
    assert clips.score(1, 2, 8) == 10.0 - 2.5 / 16
    assert Metric.clips[-1] == ((2, 4, 14, 3), "FHWC", 24.0)


@pytest.mark.usefixtures("package")
def test_frames_that_do_not_follow_one_another_are_judged_apart() -> None:
    clips = Clips(1, 24.0)
    for frame, level in ((0, 0), (1, 0), (2, 0), (5, 4)):
        clips.add(frame, grey(100), [grey(100 + level)])
    assert clips.score(0, 0, 0) == 10.0 - 1 / 16
    assert [shape[0] for shape, *_ in Metric.clips] == [3, 1]
    assert np.isnan(clips.score(0, 6, 0))


@pytest.mark.usefixtures("package")
def test_a_measurement_judges_clips_with_and_without_warm_up_and_border(tmp_path: Path) -> None:
    scene, size = Plane(checker, velocity=(1.0, 0.0)), (64, 48)
    with ShotWriter(tmp_path, name="small", display_size=size, frame_rate=25) as writer:
        for index in range(10):
            writer.write(scene.frame(index, (32, 24)), reference=scene.truth(index, size, samples=2))
    silent, judged = (measure_quality(Shot.open(tmp_path), ["bilinear"], cvvdp=c)[0] for c in (False, True))
    assert np.isnan(silent.summary()["cvvdp"])
    assert 0.0 < judged.summary()["cvvdp"] < 10.0
    shapes = {shape for shape, _, rate in Metric.clips if rate == 25}
    assert shapes == {(frames, h, w, 3) for frames in (2, 10) for h, w in ((32, 48), (48, 64))}


def test_without_the_package_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pycvvdp", None)
    with pytest.raises(SupersamplerError, match=r"pip install 'supersampler\[cvvdp\]'"):
        Clips(1, 24.0)
    answer = CliRunner().invoke(app, ["bench", "quality", "plaza", "--cvvdp"])
    assert answer.exit_code == 1
    assert answer.stderr.startswith("error: ColorVideoVDP needs the package cvvdp")
    assert answer.stderr.count("\n") == 1
