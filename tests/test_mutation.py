"""`make mutation` changes one place at a time, and only code that runs."""

import ast
from pathlib import Path

import pytest

import mutation
from mutation import ROOT, TARGETS, Finder, Mutant, chosen_mutants, equivalents, files_of


def changes(code: str) -> set[tuple[str, str]]:
    """Lines before and after each change; the whole file has to parse."""
    found = [mutant for place in Finder("module.py", code.encode()).places for mutant in place]
    assert all(ast.parse(mutant.source) for mutant in found)
    return {(mutant.before, ast.unparse(ast.parse(mutant.after.rstrip(":") or "pass"))) for mutant in found}


@pytest.mark.parametrize(
    ("code", "after"),
    [
        ("a = b < c", "a = b >= c"),
        ("a = b < 3", "a = b <= 3"),
        ("a = b - c * d", "a = b - c / d"),
        ("a = b and c", "a = b or c"),
        ("a = not b", "a = b"),
        ("a = -b", "a = b"),
        ("a = 0.5", "a = 1.0"),
        ("a = 0.5", "a = 0.0"),
        ("a = 3", "a = 4"),
        ("a = True", "a = False"),
        ("a = b[c:]", "a = b[c + 1:]"),
        ("a = f(b, c)", "a = f(c, b)"),
        ("a = torch.minimum(b, c)", "a = torch.maximum(b, c)"),
        ("a = b.clamp(min=0)", "a = b"),
        ("a = b if c else d", "a = b if not c else d"),
        ("a += b", "pass"),
        ("f()", "pass"),
        ("raise E", "pass"),
    ],
)
def test_a_change_of_each_kind_is_made(code: str, after: str) -> None:
    assert (code, after) in changes(code)


@pytest.mark.parametrize(
    "code",
    [
        '"""Text of 3 words."""', "a: Literal[3] = b", 'a = f"{b + 3}"', "@decorated(3)\ndef f(): ...",
        "T = TypeVar('T', covariant=True)", "a = zip(b, c, strict=True)", "a = 1e-6",
    ],
)  # fmt: skip
def test_texts_annotations_messages_and_guards_are_left_alone(code: str) -> None:
    assert changes(code) == set()


def test_a_sample_is_the_same_for_the_same_seed_and_has_no_equivalent_mutants() -> None:
    def drawn(seed: int) -> list[Mutant]:
        return chosen_mutants("export/parity", 400, seed)

    assert drawn(1) == drawn(1) != drawn(2)
    changed = {mutant.where for mutant in drawn(1)}
    assert "compare" in changed
    assert "noise" in {entry["where"] for entry in equivalents()} - changed


def test_each_equivalent_mutant_is_of_code_that_is_there() -> None:
    """Otherwise a renamed mutant counts twice."""
    code = " ".join(" ".join((ROOT / path).read_text(encoding="utf-8") for path in files_of(TARGETS)).split())
    for entry in equivalents():
        assert f"def {entry['where'].rpartition('.')[2]}(" in code or not entry["where"], entry
        assert " ".join(entry.get("before", "").split("#")[0].split()) in code, entry
        assert entry["reason"]


@pytest.mark.long  # in new processes
def test_the_tests_that_run_a_line_examine_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a repository of one function and one test that notices part of its changes."""
    files = {
        "sdk/a.py": "def f(x):\n    y = x + 1\n    return y * 1.0\n",
        "tests/test_a.py": "from a import f\n\n\ndef test_f():\n    assert f(1) == 2\n",
        "pyproject.toml": "[tool.coverage.run]\ndynamic_context = 'test_function'\nrelative_files = true\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    for name, value in {"ROOT": tmp_path, "OUT": tmp_path / "out", "TARGETS": ["sdk/*.py"]}.items():
        monkeypatch.setattr(mutation, name, value)
    monkeypatch.setattr(mutation, "TESTS", ["tests/*.py"])
    monkeypatch.setattr(mutation, "copy_of_repository", lambda _: tmp_path)
    (tmp_path / "out").mkdir()
    laboratory = mutation.Laboratory(1)
    laboratory.end += 600.0
    found = {mutant.after: laboratory.examine(mutant) for mutant in chosen_mutants("", 9, 0)}
    assert set(found.values()) == {"killed", "survived"}
    assert [after for after, outcome in found.items() if outcome == "survived"] == ["return ((y) / (1.0))"]
