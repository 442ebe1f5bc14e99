"""Tables of the documentation equal their records, and old records are measured again."""

import json
import re
import shutil
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest

from checker_shot import write_checker_shot
from supersampler import ArgumentError
from supersampler_bench.record import Provenance, write_json
from supersampler_bench.report.doc_tables import COMMANDS, RESULTS, Recipe, clock, find_all, measure, recipes
from upscale_runs import refusal, run, succeeded

ROOT = Path(__file__).parents[3]


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """One with a table that is recorded, one whose record is not there."""
    (tmp_path / "docs").mkdir()
    shutil.copytree(ROOT / RESULTS, tmp_path / RESULTS)
    (tmp_path / "README.md").write_text("# Title\n<!-- bench:cost -->\n<!-- /bench -->\nend\n")
    (tmp_path / "docs" / "a.md").write_text("<!-- bench:unknown -->\n<!-- /bench -->\n")
    return tmp_path


def test_every_table_of_this_repository_is_what_its_record_says() -> None:
    wrong = [
        f"{block.page}: {block.name} ({block.problem})" for block in find_all(ROOT) if not block.is_recorded
    ]
    assert wrong == [], "run `supersampler bench tables`, or the command of the record that is not there"


def test_tables_are_written_from_records_and_tables_without_a_record_are_named_and_unchanged(
    repository: Path,
) -> None:
    answer = succeeded(run("bench", "tables", repository))
    assert "a.md: unknown: left unchanged: there is no record of it" in answer.output
    readme = (repository / "README.md").read_text()
    assert re.search(r"bench:cost -->\n\| method .*\n<!-- /bench -->\nend\n$", readme, re.DOTALL)
    assert (repository / "docs" / "a.md").read_text() == "<!-- bench:unknown -->\n<!-- /bench -->\n"
    succeeded(run("bench", "tables", repository, "--check"))


@pytest.mark.parametrize(("page", "name"), [("README.md", "cost"), ("docs/a.md", "unknown")])
def test_a_number_that_no_record_holds_fails_the_check_by_name(
    repository: Path, page: str, name: str
) -> None:
    run("bench", "tables", repository)
    before = (repository / page).read_text()
    changed = re.sub(r"(bench:\w+ -->\n)", r"\g<1>| 1 |\n", before)
    (repository / page).write_text(changed)
    answer = run("bench", "tables", repository, "--check")
    assert answer.exit_code == 1
    assert f"{name}: differs from its record" in answer.output
    assert (repository / page).read_text() == changed


@pytest.mark.parametrize(
    ("name", "field", "message"),
    [("cost", "networks", "missing required field `networks`"), ("stress", "outcomes", "without 'outcomes'")],
)
def test_a_record_of_another_version_is_reported(
    repository: Path, name: str, field: str, message: str
) -> None:
    path = repository / RESULTS / f"{name}.json"
    record = json.loads(path.read_text())
    del record[field]
    write_json(record, path)
    (repository / "README.md").write_text(f"<!-- bench:{name} -->\n<!-- /bench -->\n")
    assert message in succeeded(run("bench", "tables", repository)).output


def test_a_folder_without_records_is_named(tmp_path: Path) -> None:
    assert "without records" in refusal("bench", "tables", tmp_path)


# --- `bench records` measures again what is older than the models that ship, and nothing else ---


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


def test_a_record_is_due_if_its_models_or_its_command_have_changed(root: Path) -> None:
    first, second = recipes(root)
    assert (first.problem, second.problem) == ("", "was never measured")
    assert Recipe("first", f"{COST} --steps 3", first.record).problem == "was measured by another command"
    assert Recipe("first", COST, recorded(f"{COST} --quick")).problem == "was measured by another command"
    changed = recorded(COST, model_digests={"taau": "other"})
    assert Recipe("first", COST, changed).problem.endswith("another version of taau.")
    with pytest.raises(ArgumentError, match="third"):
        list(recipes(root, ["third"]))


def test_a_record_without_its_command_is_due_and_a_file_of_other_commands_is_refused(root: Path) -> None:
    (root / RESULTS / "first.json").write_text('{"bench": "cost", "shots": [{"name": "plaza"}]}')
    assert (
        "first: was measured by another"
        in succeeded(run("bench", "records", "--list", "--root", root)).output
    )
    (root / COMMANDS).write_text("[commands]\nfirst = 3\n")
    assert "Expected `str`, got `int`" in refusal("bench", "records", "--root", root)


@pytest.mark.long  # runs commands in processes
def test_a_failing_command_keeps_the_record_and_gives_the_reason(root: Path) -> None:
    said: list[str] = []
    first, second = recipes(root)
    assert not measure(root, second, said.append)
    assert "--bad" in said[0]
    assert not (root / "bench/results/second.json").exists()
    assert measure(root, first, said.append)
    assert json.loads((root / "bench/results/first.json").read_text())["bench"] == "cost"


def test_published_records_of_quality_have_no_scores_of_frames(root: Path, tmp_path: Path) -> None:
    shot = write_checker_shot(tmp_path / "shot")
    command = f"supersampler bench quality {shot} --methods bilinear"
    (root / COMMANDS).write_text(f'[commands]\nquality = "{command}"\n')
    [recipe] = recipes(root)
    assert measure(root, recipe, print)
    record = json.loads((root / "bench/results/quality.json").read_text())
    assert record["shots"][0]["methods"][0]["frames"] == []
    assert record["shots"][0]["masks"] == "depth and motion"
    for path in (ROOT / "bench/results").glob("quality*.json"):
        assert '"frames": [\n' not in path.read_text(encoding="utf-8"), path.name


def test_listing_measures_nothing(root: Path) -> None:
    result = succeeded(run("bench", "records", "--list", "--root", root))
    assert "second: was never measured" in result.output
    assert "first" not in result.output


def test_durations_are_printed_in_seconds_minutes_or_hours() -> None:
    said = [clock(seconds) for seconds in (4.4, 119.0, 600.0, 5400.0)]
    assert said == ["4 s", "2 min", "10 min", "1 h 30 min"]
