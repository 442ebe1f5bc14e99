"""The mutation tool changes one place at a time, and only code that runs."""

import ast
from pathlib import Path

import pytest

from mutation import __main__ as tool
from mutation.coverage_map import CoverageMap, targets_of
from mutation.mutants import Mutant, mutants_of, sample
from mutation.targets import STRONG

CODE = '''"""Text of 3 words."""
LIMIT: int = 4

def share(values: list[float], *, upper: float = 2.0) -> float:
    """Return 1."""
    if not values:
        raise ValueError(f"no values, {len(values) + 1} wanted")
    total = sum(values[: len(values) - 1]) / max(1e-9, upper)
    return min(total, upper) if total > 0.0 else -total
'''


def changes(code: str) -> set[tuple[str, str]]:
    """Replacements, as expressions."""
    source = code.encode()
    found = [m for place in mutants_of("module.py", source) for m in place if m.is_change(source)]
    return {(source[m.start : m.end].decode(), ast.unparse(ast.parse(m.new))) for m in found}


@pytest.mark.parametrize(
    ("code", "before", "after"),
    [
        ("a = b < c", "b < c", "b >= c"),
        ("a = b < 3", "b < 3", "b <= 3"),
        ("a = b - c * d", "c * d", "c / d"),
        ("a = b - c", "b - c", "c - b"),
        ("a = b and c", "b and c", "b or c"),
        ("a = not b", "not b", "b"),
        ("a = -b", "-b", "b"),
        ("a = 0.5", "0.5", "1.0"),
        ("a = 0.5", "0.5", "0.0"),
        ("a = 3", "3", "4"),
        ("a = True", "True", "False"),
        ("a = b[c:]", "c", "c + 1"),
        ("a = f(b, c)", "f(b, c)", "f(c, b)"),
        ("a = f(b, mode=2)", "f(b, mode=2)", "f(b)"),
        ("a = torch.minimum(b, c)", "torch.minimum(b, c)", "torch.maximum(b, c)"),
        ("a = b.clamp(min=0)", "b.clamp(min=0)", "b"),
        ("if a:\n    b = c", "a", "not a"),
        ("a += b", "a += b", "a -= b"),
        ("f()", "f()", "pass"),
        ("raise E", "raise E", "pass"),
        ("def f() -> list[int]:\n    return g()", "g()", "[]"),
        ("def f() -> int | None:\n    return g()", "g()", "None"),
    ],
)
def test_a_change_of_each_kind_is_made(code: str, before: str, after: str) -> None:
    assert (before, after) in changes(code)


def test_texts_annotations_messages_and_guards_are_left_alone() -> None:
    changed = {before for before, _ in changes(CODE)}
    assert not changed & {"1e-9", "len(values) + 1", "int", "list[float]"}
    assert ("4", "5") in changes(CODE)
    assert not changes("T = TypeVar('T', covariant=True)")
    assert ("True", "False") not in changes("a = zip(b, c, strict=True)")
    texts = (
        "a: Literal[3] = b",
        "raise E(3)",
        'a = f"{b + 3}"',
        "@decorated(3)\ndef f(): ...",
        "a = b + 1e-6",
    )
    assert all("3" not in {before for before, _ in changes(text)} for text in texts)
    assert "1e-6" not in {before for before, _ in changes(texts[-1])}


def test_a_symmetric_difference_is_not_mutated_by_swapping() -> None:
    for code in ("a = abs(b - c)", "a = (b - c).abs()", "a = (b - c) ** 2", "a = np.square(b - c)"):
        assert ("b - c", "b + c") in changes(code)
        assert ("b - c", "c - b") not in changes(code)


def test_a_mutant_changes_one_place_and_parses() -> None:
    source = CODE.encode()
    for mutant in (m for place in mutants_of("module.py", source) for m in place):
        changed = mutant.applied(source)
        assert changed.startswith(source[: mutant.start])
        assert changed.endswith(source[mutant.end :])
        ast.parse(changed)


def test_a_sample_is_the_same_for_the_same_seed_and_takes_one_of_each_place() -> None:
    places = mutants_of("module.py", CODE.encode())

    def drawn(seed: int) -> list[Mutant]:
        return list(sample(places, seed))

    assert drawn(1) == drawn(1)
    assert drawn(1) != drawn(2)
    assert sorted(places.index(p) for m in drawn(1) for p in places if m in p) == list(range(len(places)))


def test_each_equivalent_mutant_is_of_code_that_is_there() -> None:
    """Otherwise a renamed mutant counts twice."""
    root = Path(tool.__file__).parents[2]
    texts = [(root / path).read_text(encoding="utf-8") for path in targets_of(root)]
    code = " ".join(" ".join(texts).split())
    for where, *change in tool.equivalents():
        assert f"def {where.rpartition('.')[2]}(" in code or not where, where
        assert all(" ".join(before.split("#")[0].split()) in code for before in change[:1]), change


def test_tests_that_compare_all_results_run_first_though_others_are_quicker() -> None:
    strong, slow, quick = f"{STRONG[0]}::test_step", "tests/test_slow.py::test", "tests/test_quick.py::test"
    seconds = {strong: 3.0, slow: 2.0, quick: 0.1}
    coverage = CoverageMap(seconds, {"module.py": {line: {*seconds} for line in range(1, 10)}})
    for mutant in (mutant for place in mutants_of("module.py", CODE.encode()) for mutant in place):
        assert coverage.tests_for(mutant) == [strong, quick, slow]
