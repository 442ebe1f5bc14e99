"""The bench of scenes that stand still compares them with the mean of the samples."""

import json
from pathlib import Path

import pytest

from supersampler.conventions import jitter_phase_count
from supersampler_bench.quality.still import PERIODS, StillRecord, StillScores, frame_count, make_scene
from supersampler_bench.record import read_record
from upscale_runs import refusal, run, succeeded

DISPLAY = (96, 54)


@pytest.mark.long  # renders a shot
def test_pixels_near_what_moves_or_changes_are_not_scored() -> None:
    still, mover = (make_scene(name, DISPLAY, 1.0, 4) for name in ("analytic", "analytic-mover"))
    assert still.still.all()
    scale = (
        DISPLAY[0] / 64.0
    )  # pixels per unit of the scene; the disc's way begins at (-4, 8) units, radius 4
    assert not mover.still[round(8 * scale), : round(10 * scale)].any()
    assert mover.still[round(20 * scale) :].all()
    objects = make_scene("court-mover", DISPLAY, 1.0, 4)
    assert 0.0 < objects.still.mean() < 0.25  # its lights change, too, where nothing moves


def test_the_command_measures_every_scene_and_backend_and_writes_all_files(tmp_path: Path) -> None:
    file = tmp_path / "still.json"
    command = ["still", "--scenes", "analytic:1,analytic-mover:1", "--methods", "taau", "--json", file]
    answer = succeeded(run("bench", *command, "--display-size", "96x54", "-o", tmp_path))
    record = StillRecord.from_json(read_record(file))
    scores = record.scores
    assert [(s.scene, s.ratio, s.executor) for s in scores] == [
        (scene, 1.0, executor) for scene in ("analytic", "analytic-mover") for executor in ("cpu", "onnx")
    ]
    assert all(len(s.psnr) == frame_count(1.0) for s in scores)
    assert all(s.after(4) > s.psnr[0] + 3.0 for s in scores)
    assert record.summary_table() in answer.output
    assert "| analytic-mover | 1 | taau | onnx |" in answer.output
    assert (tmp_path / "still.png").stat().st_size > 10_000


def test_the_summary_shows_all_scenes_at_the_ratio_closest_to_2() -> None:
    def score(scene: str, ratio: float, executor: str, level: float) -> StillScores:
        psnr = [level + 0.1 * (index // jitter_phase_count(ratio)) for index in range(frame_count(ratio))]
        return StillScores(scene, ratio, "taau", executor, 1.0, psnr, 0.0001)

    scores = [
        score("analytic", 1.0, "cpu", 20.0),
        *(score(scene, 2.0, kind, 30.0) for scene in ("analytic", "court") for kind in ("cpu", "onnx")),
    ]
    written = json.dumps(StillRecord(DISPLAY, scores).to_json())
    record = StillRecord.from_json(json.loads(written))
    assert [scores[1].after(count) for count in PERIODS] == pytest.approx([30.0, 30.1, 30.3])
    summary = record.summary_table()
    assert "| taau | cpu | 30.0 | 30.1 | 30.3 | 30.3 |" in summary
    assert "| taau | onnx | 30.0 | 30.1 | 30.3 | 30.3 |" in summary
    assert "20." not in summary.partition("\n\n")[0]
    row = "| taau | cpu | 100 % | 20.0 | 20.1 | 20.3 | 0.0001 |"
    assert f"| analytic | 1 {row}" in record.table()


@pytest.mark.parametrize("command", ["still -o", "pareto -o", "parity --json"])
def test_an_output_below_a_file_is_refused_before_the_measurement(tmp_path: Path, command: str) -> None:
    (tmp_path / "file").touch()
    said = refusal("bench", *command.split(), tmp_path / "file" / "output")
    assert "file is not a folder. Choose another name." in said


@pytest.mark.parametrize("scenes", ["courtyard:2", "analytic", "analytic:two"])
def test_an_unknown_scene_or_a_missing_ratio_is_refused(scenes: str) -> None:
    assert "--scenes" in refusal("bench", "still", "--scenes", scenes)
