"""Results of the mutation tool are kept as long as they hold."""

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from mutation import __main__ as tool
from mutation.coverage_map import CoverageMap, targets_of
from mutation.mutants import mutants_of

FILES = ["tests/model/test_a.py", "tests/model/test_b.py"]


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tool, "TREE", tmp_path)
    for file in FILES:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("def test_it(): ...\n")
    return tmp_path


def test_results_are_found_again_until_what_they_hang_on_changes(tree: Path) -> None:
    kept = tree / "results.jsonl"
    first = tool.Results(kept)
    first.add("one", tool.KILLED, f"{FILES[0]}::test_it")
    first.add("two", tool.SURVIVED, "")

    def found() -> list[bool]:
        again = tool.Results(kept)
        return [again.find(mutant) is not None for mutant in ("one", "two", "three")]

    assert found() == [True, True, False]
    (tree / FILES[1]).write_text("def test_more(): ...\n")
    assert found() == [True, False, False], "another test may notice what survived"
    (tree / FILES[0]).write_text("def test_less(): ...\n")
    assert found() == [False, False, False]


def test_an_entry_without_a_reason_leaves_nothing_out(monkeypatch: pytest.MonkeyPatch) -> None:
    listed = {
        "equivalent": [
            {"where": "f", "reason": ""},
            {"where": "g", "before": "a", "after": "b", "reason": "c"},
        ]
    }
    monkeypatch.setattr(tomllib, "loads", lambda _: listed)
    assert tool.equivalents() == {("g", "a", "b")}


def test_each_entry_is_of_code_that_is_there() -> None:
    """Else what was renamed counts again."""
    root = Path(tool.__file__).parents[2]
    texts = [(root / path).read_text(encoding="utf-8") for path in targets_of(root)]
    code = " ".join(" ".join(texts).split())
    for where, *change in tool.equivalents():
        assert f"def {where.rpartition('.')[2]}(" in code or not where, where
        assert all(" ".join(before.split("#")[0].split()) in code for before in change[:1]), change


def test_tests_that_run_the_line_are_chosen_and_on_import_those_that_run_most_of_the_module() -> None:
    seconds = {"quick": 0.1, "slow": 9.0, "other": 0.1, "beside": 0.1, "apart": 0.1}
    lines = {
        "a.py": {2: {"slow", "quick"}, 3: {"slow"}, **{line: {"slow", "other"} for line in range(4, 400)}},
        "b.py": {1: {"beside"}},
        "c.py": {1: {"apart"}},
    }
    tests = CoverageMap(seconds, lines)
    found = {m.line: m for place in mutants_of("a.py", b"A = 1\ndef f():\n    return 2\n") for m in place}
    assert tests.tests_for(replace(found[3], lines=(2, 2)), ["b.py"]) == ["quick", "slow"]
    assert tests.tests_for(found[1], ["b.py"]) == ["other", "slow", "quick", "beside"]
