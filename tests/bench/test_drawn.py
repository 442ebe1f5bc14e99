"""Colours that were drawn, before anything upscales them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from lit_scene import LitScene
from supersampler import Shot, ShotError, halton_jitter
from supersampler.cli import app
from supersampler.io.shot import ShotWriter
from supersampler_bench.drawn import measure_drawn
from supersampler_bench.record import read_record
from supersampler_bench.tables import blocks_of

SIZE, FRAMES = (48, 27), 13
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("shots") / "lit"
    with ShotWriter(path, name="lit", display_size=SIZE, frame_rate=24) as writer:
        for index in range(FRAMES):
            writer.write(SCENE.frame(index, SIZE, halton_jitter(index, 1.0)))
    return Shot.open(path).path


def test_what_a_model_draws_is_nearer_to_the_samples_than_the_last_frame_warped(folder: Path) -> None:
    done: list[int] = []
    scores = measure_drawn(Shot.open(folder), ["guided-warp"], on_frame=done.append)
    assert list(scores.psnr) == ["warp", "guided-warp"]
    assert scores.psnr["guided-warp"] > scores.psnr["warp"] + 3.0
    assert done == list(range(1, FRAMES + 1))


def test_where_nothing_moves_a_warped_frame_is_the_frame(tmp_path: Path) -> None:
    still = LitScene().frame(0, SIZE)
    with ShotWriter(tmp_path / "still", name="still", display_size=SIZE, frame_rate=24) as writer:
        for index in range(FRAMES):
            writer.write(replace(still, reset=index == 0))
    psnr = measure_drawn(Shot.open(tmp_path / "still"), ["guided-warp"]).psnr
    assert psnr["warp"] > 60.0
    assert psnr["guided-warp"] > 30.0


def test_the_command_prints_a_table_and_a_record_that_makes_it_again(folder: Path, tmp_path: Path) -> None:
    page, file = tmp_path / "page.md", tmp_path / "drawn-lit.json"
    page.write_text("<!-- bench:drawn lit -->\n<!-- /bench -->\n")
    done = CliRunner().invoke(
        app, ["bench", "drawn", str(folder), "--json", str(file), "--update", str(page)]
    )
    assert done.exit_code == 0, done.output
    record = read_record(file)
    table = blocks_of("drawn-lit", record)["drawn lit"]()
    assert table in page.read_text()
    assert "| PSNR dB | lit | mean |" in table
    assert np.isfinite(record["shots"][0]["psnr"]["warp"])


def test_a_shot_without_the_buffers_is_refused(tmp_path: Path) -> None:
    with ShotWriter(tmp_path / "bare", name="bare", display_size=SIZE, frame_rate=24) as writer:
        writer.write(replace(SCENE.frame(0, SIZE), gbuffer=None))
    with pytest.raises(ShotError, match="frames have no base_color, normal at render size"):
        measure_drawn(Shot.open(tmp_path / "bare"), ["guided-warp"])
