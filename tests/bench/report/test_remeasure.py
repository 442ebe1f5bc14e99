"""`bench records` measures again what is older than the models that ship, and nothing else."""

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from supersampler import ArgumentError
from supersampler.cli import app
from supersampler.io.shot import ShotWriter
from supersampler_bench.record import Provenance
from supersampler_bench.report.doc_tables import COMMANDS, Recipe, clock, measure, recipes
from supersampler_model.data.scenes.analytic import Plane, checker

ROOT = Path(__file__).parents[3]
COST = "supersampler bench cost --methods classifier-small"


def recorded(command: str, **values: Any) -> dict[str, Any]:
    return {
        "bench": "cost",
        "rows": ["taau"],
        **asdict(Provenance.now()),
        "command": command.split(),
        **values,
    }


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A repository of two records, the second of which was never measured."""
    (tmp_path / "bench/results").mkdir(parents=True)
    (tmp_path / COMMANDS).write_text(
        f'[commands]\nfirst = "{COST}"\nsecond = "supersampler bench cost --bad"\n'
    )
    (tmp_path / "bench/results/first.json").write_text(json.dumps(recorded(f"{COST} --json elsewhere.json")))
    return tmp_path


def test_every_record_of_this_repository_has_a_command_or_a_reason() -> None:
    known = tomllib.loads((ROOT / COMMANDS).read_text(encoding="utf-8"))
    found = {path.stem for path in (ROOT / "bench/results").glob("*.json")}
    assert found <= known["commands"].keys() | known["elsewhere"].keys()


def test_a_record_is_due_where_its_models_or_its_command_have_changed(root: Path) -> None:
    first, second = recipes(root)
    assert (first.problem, second.problem) == ("", "was never measured")
    assert Recipe("first", f"{COST} --steps 3", first.record).problem == "was measured by another command"
    changed = recorded(COST, model_digests={"taau": "other"})
    assert Recipe("first", COST, changed).problem.endswith("another version of taau.")
    with pytest.raises(ArgumentError, match="third"):
        list(recipes(root, ["third"]))


@pytest.mark.long  # runs commands in processes
def test_a_command_that_fails_leaves_the_record_and_says_why(root: Path) -> None:
    said: list[str] = []
    first, second = recipes(root)
    assert not measure(root, second, said.append)
    assert "--bad" in said[0]
    assert not (root / "bench/results/second.json").exists()
    assert measure(root, first, said.append)
    assert json.loads((root / "bench/results/first.json").read_text())["bench"] == "cost"


def test_records_of_quality_hold_summaries_and_no_single_frames(root: Path, tmp_path: Path) -> None:
    scene, shot = Plane(checker, velocity=(1.0, 0.0)), tmp_path / "shot"
    with ShotWriter(shot, name="small", display_size=(80, 60), frame_rate=30) as writer:
        for index in range(10):
            writer.write(scene.frame(index, (40, 30)), reference=scene.truth(index, (80, 60), samples=2))
    command = f"supersampler bench quality {shot} --methods bilinear"
    (root / COMMANDS).write_text(f'[commands]\nquality = "{command}"\n')
    [recipe] = recipes(root)
    assert measure(root, recipe, print)
    record = json.loads((root / "bench/results/quality.json").read_text())
    assert record["shots"][0]["methods"][0]["frames"] == []
    for path in (ROOT / "bench/results").glob("quality*.json"):
        assert '"frames": [\n' not in path.read_text(encoding="utf-8"), path.name


def test_the_list_measures_nothing(root: Path) -> None:
    result = CliRunner().invoke(app, ["bench", "records", "--list", "--root", str(root)])
    assert result.exit_code == 0, result.output
    assert "second: was never measured" in result.output
    assert "first" not in result.output


def test_durations_are_said_in_seconds_minutes_or_hours() -> None:
    assert [clock(seconds) for seconds in (4.4, 119.0, 600.0, 5400.0)] == [
        "4 s",
        "2 min",
        "10 min",
        "1 h 30 min",
    ]
