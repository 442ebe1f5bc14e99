"""What the mutation tool has found is kept as long as it holds."""

import tomllib
from pathlib import Path

import pytest

from mutation import __main__ as tool

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
