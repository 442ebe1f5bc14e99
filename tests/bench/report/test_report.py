"""Tables of the documentation equal their records; the HTML page needs no other file."""

import json
import re
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from supersampler import ArgumentError
from supersampler_bench.cli import app
from supersampler_bench.record import write_json
from supersampler_bench.report.doc_tables import RESULTS, find_all

ROOT = Path(__file__).parents[3]
PNG = "data:image/png;base64,"


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


def test_tables_are_written_from_records_and_those_without_one_are_named_and_left_alone(
    repository: Path,
) -> None:
    answer = CliRunner().invoke(app, ["tables", str(repository)])
    assert answer.exit_code == 0, answer.output
    assert "a.md: unknown: left alone: there is no record of it" in answer.output
    readme = (repository / "README.md").read_text()
    assert re.search(r"bench:cost -->\n\| method .*\n<!-- /bench -->\nend\n$", readme, re.DOTALL)
    assert (repository / "docs" / "a.md").read_text() == "<!-- bench:unknown -->\n<!-- /bench -->\n"
    assert CliRunner().invoke(app, ["tables", str(repository), "--check"]).exit_code == 0


@pytest.mark.parametrize(("page", "name"), [("README.md", "cost"), ("docs/a.md", "unknown")])
def test_a_number_that_is_in_no_record_fails_the_check_by_its_name(
    repository: Path, page: str, name: str
) -> None:
    CliRunner().invoke(app, ["tables", str(repository)])
    before = (repository / page).read_text()
    changed = re.sub(r"(bench:\w+ -->\n)", r"\g<1>| 1 |\n", before)
    (repository / page).write_text(changed)
    answer = CliRunner().invoke(app, ["tables", str(repository), "--check"])
    assert answer.exit_code == 1
    assert f"{name}: is not what its record says" in answer.output
    assert (repository / page).read_text() == changed


def test_a_record_of_another_version_is_said_to_be_one(repository: Path) -> None:
    path = repository / RESULTS / "cost.json"
    record = json.loads(path.read_text())
    del record["networks"]
    write_json(record, path)
    answer = CliRunner().invoke(app, ["tables", str(repository)])
    assert answer.exit_code == 0
    assert "missing required field `networks`" in answer.output


def test_a_folder_without_records_is_named(tmp_path: Path) -> None:
    answer = CliRunner().invoke(app, ["tables", str(tmp_path)])
    assert isinstance(answer.exception, ArgumentError)
    assert "without records" in str(answer.exception)
