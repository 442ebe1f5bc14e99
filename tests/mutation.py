"""`make mutation`: changes one place of the code at a time, and prints the changes that no test notices.

MUTATIONS=300 places, drawn by SEED=0, in MINUTES=60 at most; ONLY=part of a path. The lines that each test
runs are recorded in out/mutation, beside a copy of the repository for each core.

A script of our own: mutmut puts a dispatcher in front of each function, which torch.export would trace, and
cosmic-ray runs the same tests for each mutant.
"""

import ast
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from queue import SimpleQueue

from coverage import CoverageData

ROOT = Path(__file__).parents[1]
OUT = ROOT / "out" / "mutation"
PACKAGES = ("sdk", "model", "export", "bench")
TARGETS = (
    "model/supersampler_model/methods/**/*.py",
    "model/supersampler_model/training/losses.py",
    "model/supersampler_model/training/*task*.py",
    "model/supersampler_model/data/labels.py",
    "export/supersampler_export/[!c]*.py",  # without cli.py, which has help texts
    "sdk/supersampler/conventions/*.py",
    "sdk/supersampler/validation/*.py",
)
"""Globs of the files that are changed."""
TESTS = (
    "tests/export/test_shipped_steps.py",  # compares all results of a step
    "tests/export/test_[!e]*.py",  # without test_export_traced.py, which traces for minutes
    "tests/export/test_export.py",
    "tests/export/test_export_extrapolated.py",
    "tests/model/*.py",
    "tests/model/train/*.py",
    "tests/model/data/test_label*.py",
    "tests/model/data/test_thin.py",
    "tests/sdk/test_*camera_motion.py",
    "tests/sdk/test_*checks*.py",
    "tests/sdk/test_*conventions*.py",
    "tests/sdk/test_backward_motion.py",
    "tests/sdk/test_bad_arguments.py",
    "tests/sdk/test_detect*.py",
    "tests/sdk/test_extrapolat*.py",
    "tests/sdk/test_gbuffers.py",
    "tests/sdk/test_jitter.py",
    "tests/sdk/test_planted_mistakes.py",
    "tests/test_golden.py",
)
"""Globs of the tests that may notice, in the order in which they run."""
SECONDS = 60.0
"""Most that the tests of one mutant may take; what they have not noticed by then survives."""
MEMORY = 12 << 20
"""KiB of data that a process may hold: a mutant may ask for any size."""

NEGATED: dict[type[ast.cmpop], str] = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
SHIFTED: dict[type[ast.cmpop], str] = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
SWAPPED: dict[type[ast.operator], str] = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*", ast.Pow: "*",
    ast.BitAnd: "|", ast.BitOr: "&", ast.LShift: ">>", ast.RShift: "<<",
}  # fmt: skip
OPPOSITES = (
    ("minimum", "maximum"), ("min", "max"), ("any", "all"), ("floor", "ceil"), ("sin", "cos"),
    ("zeros", "ones"), ("zeros_like", "ones_like"), ("sum", "mean"),
)  # fmt: skip
OPPOSITE = {a: b for pair in OPPOSITES for a, b in (pair, pair[::-1])}
DROPPED = {"clamp", "clip", "abs", "floor", "round", "sqrt", "square", "detach", "exp", "log"}
"""Methods whose result can stand in for what they are called on."""
UNORDERED = {"minimum", "maximum", "min", "max", "isinstance", "zip", "isclose", "add", "multiply", "gcd"}
"""Functions whose first two arguments may change places, or fail at once if they do."""
UNSEEN = {"copy", "device", "strict", "slots", "frozen"}
"""Keywords that change no value on this machine unless there is another error."""
SILENT = ("Error", "Warning", "warn", "cast", "TypeVar")
"""Suffixes of calls that only build messages or inform the type checker."""
GUARD = 1e-4
"""Smaller numbers guard divisions; no test can notice another value."""


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        path: path of the file from the root of the repository.
        where: qualified name of the function or class around the change; empty at module level.
        lines: numbers of the lines of the statement that contains the change.
        before, after: the changed lines, joined to one line without indentation.
        source: the whole changed file.
    """

    path: str
    where: str
    lines: range
    before: str
    after: str
    source: bytes


class Finder(ast.NodeVisitor):
    """Walks through the code that runs: no annotations, decorators, texts, or messages of errors.

    Attributes:
        places: mutants of the file, place by place.
    """

    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.source = path, source
        self.starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
        self.scope: list[str] = []
        self.statement: ast.stmt | None = None
        self.places: list[list[Mutant]] = []
        self.visit(ast.parse(source))

    def visit(self, node: ast.AST) -> None:
        """Collect the mutants of `node`, then of its children."""
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Call) and _name(node).endswith(SILENT)):
            return
        outer, self.statement = self.statement, node if isinstance(node, ast.stmt) else self.statement
        if isinstance(node, ast.expr | ast.stmt):
            self.places.append([self._mutant(part, new) for part, new in _replacements(node)])
        if not isinstance(node, ast.Raise):
            super().visit(node)
        self.statement = outer

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Visit defaults and body."""
        if not {_name(decorator) for decorator in node.decorator_list} & {"overload", "abstractmethod"}:
            defaults = [default for default in node.args.kw_defaults if default is not None]
            self._visit_inside(node, [*node.args.defaults, *defaults, *node.body])

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Visit the body alone."""
        self._visit_inside(node, node.body)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Visit the value alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        """Skip values without effect on this machine."""
        if node.arg not in UNSEEN:
            self.visit(node.value)

    def _visit_inside(self, node: ast.FunctionDef | ast.ClassDef, parts: Iterable[ast.AST]) -> None:
        self.scope.append(node.name)
        for part in parts:
            self.visit(part)
        self.scope.pop()

    def _mutant(self, node: ast.expr | ast.stmt, new: str) -> Mutant:
        statement, last = self.statement, node.end_lineno or node.lineno
        assert statement is not None
        start = self.starts[node.lineno - 1] + node.col_offset
        end = self.starts[last - 1] + (node.end_col_offset or 0)
        source = self.source[:start] + new.encode() + self.source[end:]
        first, beyond = self.starts[node.lineno - 1], self.starts[last]
        ends = beyond, beyond + len(source) - len(self.source)
        before, after = (
            " ".join(text[first:end].decode().split())
            for text, end in zip((self.source, source), ends, strict=True)
        )
        body = getattr(statement, "body", None)  # of which tests may run nothing
        next_line = body[0].lineno if isinstance(body, list) and body else (statement.end_lineno or 0) + 1
        lines = range(statement.lineno, max(next_line, statement.lineno + 1))
        return Mutant(self.path, ".".join(self.scope), lines, before, after, source)


def _name(node: ast.expr) -> str:
    """Last part of a dotted name, of a call that of its function."""
    match node:
        case ast.Call(func=function):
            return _name(function)
        case ast.Attribute(attr=name) | ast.Name(id=name):
            return name
    return ""


def _replacements(node: ast.expr | ast.stmt) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield what may stand in for `node` or for a part of it."""
    text = ast.unparse
    match node:
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            for table in (NEGATED, SHIFTED if isinstance(right, ast.Constant) else {}):
                if type(op) in table:
                    yield node, f"({text(left)} {table[type(op)]} {text(right)})"
        case ast.BinOp(left=left, op=op, right=right) if not isinstance(left, ast.JoinedStr):
            if type(op) in SWAPPED:
                yield node, f"(({text(left)}) {SWAPPED[type(op)]} ({text(right)}))"
        case ast.BoolOp(op=op, values=values):
            word = " or " if isinstance(op, ast.And) else " and "
            yield node, f"({word.join(f'({text(value)})' for value in values)})"
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield node, f"({text(operand)})"
        case ast.Constant(value=value):
            yield from ((node, new) for new in _other_constants(value))
        case ast.Slice(lower=lower, upper=upper):
            bounds = [b for b in (lower, upper) if b is not None and not isinstance(b, ast.Constant)]
            yield from ((bound, f"({text(bound)} + 1)") for bound in bounds)
        case ast.Call():
            yield from ((node, new) for new in _other_calls(node))
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            if not isinstance(test, ast.Compare | ast.UnaryOp):  # which have mutants of their own
                yield test, f"(not ({text(test)}))"
        case ast.Raise() | ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield node, "pass"


def _other_constants(value: object) -> Iterator[str]:
    if isinstance(value, bool):
        yield str(not value)
    elif isinstance(value, int):
        yield str(value + 1)
    elif isinstance(value, float) and value == 0.0:
        yield "1.0"
    elif isinstance(value, float) and abs(value) > GUARD:
        yield repr(2.0 * value)
        yield "0.0"


def _other_calls(node: ast.Call) -> Iterator[str]:
    name, callee = _name(node), ast.unparse(node.func)
    arguments, keywords = map(ast.unparse, node.args), map(ast.unparse, node.keywords)
    first, second, *others = [*arguments, "", ""]
    if second and first != second and name not in UNORDERED:
        yield f"{callee}({', '.join(filter(None, [second, first, *others, *keywords]))})"
    elif name in OPPOSITE:
        inside = ", ".join(filter(None, [first, second, *others, *keywords]))
        yield f"{callee.removesuffix(name)}{OPPOSITE[name]}({inside})"
    elif name in DROPPED and callee.rpartition(".")[0] not in ("", "np", "torch", "math"):
        yield f"({callee.rpartition('.')[0]})"


def equivalents() -> list[dict[str, str]]:
    """Return the entries of mutation.toml: mutants that change nothing, and functions that are left out."""
    found: list[dict[str, str]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())["equivalent"]
    return found


def chosen_mutants(only: str, count: int, seed: int) -> list[Mutant]:
    """Return a random sample of the mutants that are not equivalent, at most one of each place.

    The order depends on the seed and the code alone: unchanged code keeps it, also in another module.
    """

    def lot(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.where} {mutant.before} {mutant.after}".encode()).digest()

    def key(*texts: str) -> str:
        return re.sub(r"[\s()]", "", "\0".join(texts))

    paths = [path for path in files_of(TARGETS) if only in path]
    places = [place for path in paths for place in Finder(path, (ROOT / path).read_bytes()).places]
    drawn = sorted((min(place, key=lot) for place in places if place), key=lot)
    left_out = {
        key(*(entry[n] for n in ("where", "before", "after") if n in entry)) for entry in equivalents()
    }
    return [m for m in drawn if not {key(m.where), key(m.where, m.before, m.after)} & left_out][:count]


def files_of(globs: Iterable[str]) -> list[str]:
    """Return the files that globs find, by their paths from the root of the repository."""
    return list(dict.fromkeys(str(f.relative_to(ROOT)) for glob in globs for f in sorted(ROOT.glob(glob))))


class Laboratory:
    """Copies of the repository, in which tests run on mutants, and the tests that run each line."""

    def __init__(self, cores: int) -> None:
        self.trees = SimpleQueue[Path]()
        for number in range(cores):
            self.trees.put(copy_of_repository(OUT / f"tree-{number}"))
        targets = [(ROOT / path).read_bytes() for path in files_of(TARGETS)]
        self.digest = hashlib.sha256(b"\0".join(targets)).digest()
        self.end = time.monotonic()
        with ThreadPoolExecutor(cores) as workers:
            self.records = dict(zip(files_of(TESTS), workers.map(self.record, files_of(TESTS)), strict=True))

    @contextmanager
    def tree(self) -> Iterator[Path]:
        """Take a copy of the repository for the duration of the block."""
        tree = self.trees.get()
        try:
            yield tree
        finally:
            self.trees.put(tree)

    def record(self, test_file: str) -> CoverageData:
        """Return the lines that a file's tests run, as recorded unless one of the files has changed."""
        digest = hashlib.sha256(self.digest + (ROOT / test_file).read_bytes()).hexdigest()[:16]
        data = CoverageData(str(OUT / f"{Path(test_file).stem}-{digest}.coverage"))
        if not Path(data.data_filename()).exists():
            with self.tree() as tree:
                options = [f"--data-file={data.data_filename()}", f"--include={','.join(files_of(TARGETS))}"]
                run_python(tree, 600.0, "coverage", "run", *options, "-m", "pytest", "-q", test_file)
            print(f"recorded {test_file}", flush=True)
        data.read()
        return data

    def tests_for(self, mutant: Mutant) -> list[str]:
        """Return the tests that run a line of a change.

        A line that no test runs by itself, on import or in a fixture, is of all tests that run its module.
        """
        here, everywhere = list[str](), list[str]()
        for test_file, data in self.records.items():
            for line, contexts in data.contexts_by_lineno(mutant.path).items():
                tests = [f"{test_file}::{c.rpartition('.')[2]}" for c in contexts if c]
                everywhere += tests
                here += tests if line in mutant.lines else []
        return list(dict.fromkeys(here or everywhere))

    def examine(self, mutant: Mutant) -> str:
        """Return what becomes of a mutant: "not tried" after the end."""
        tests = self.tests_for(mutant)
        if time.monotonic() > self.end or not tests:
            return "survived" if not tests else "not tried"
        with self.tree() as tree:
            file, source = tree / mutant.path, (ROOT / mutant.path).read_bytes()
            file.write_bytes(mutant.source)
            code = run_python(tree, SECONDS, "pytest", "-x", "-q", "--timeout=30", *tests)
            file.write_bytes(source)
        return "survived" if code in (0, None) else "killed"


def copy_of_repository(tree: Path) -> Path:
    """Make `tree` hold what git sees in the repository: changed files alone are copied."""
    listed = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, capture_output=True, check=True, text=True).stdout.split("\0")
    for source, target in ((ROOT / name, tree / name) for name in filter(None, names)):
        if not source.is_file():
            target.unlink(missing_ok=True)
        elif not target.exists() or source.read_bytes() != target.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
    return tree


def run_python(tree: Path, seconds: float, *arguments: str) -> int | None:
    """Run Python in a copy of the repository; return its exit code, or None after so many seconds."""
    command = ["sh", "-c", f'ulimit -d {MEMORY}; exec "$@"', "sh", sys.executable, "-m", *arguments]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(str(tree / package) for package in PACKAGES)
    with tree.with_suffix(".log").open("wb") as log:
        process = subprocess.Popen(
            command, cwd=tree, env=environment, stdout=log, stderr=log, start_new_session=True
        )
    try:
        return process.wait(seconds)
    except subprocess.TimeoutExpired:
        return None
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)  # and what its tests have started


def main() -> None:
    """Print the mutants of a random sample of places that no test notices."""
    settings, cores = os.environ.get, os.cpu_count() or 1
    OUT.mkdir(parents=True, exist_ok=True)
    laboratory = Laboratory(cores)
    laboratory.end = time.monotonic() + 60.0 * float(settings("MINUTES", "60"))
    mutants = chosen_mutants(
        settings("ONLY", ""), int(settings("MUTATIONS", "300")), int(settings("SEED", "0"))
    )
    counts = Counter[str]()
    with ThreadPoolExecutor(cores) as workers:
        for mutant, outcome in zip(mutants, workers.map(laboratory.examine, mutants), strict=True):
            counts[outcome] += 1
            said = f"{mutant.path}:{mutant.lines[0]} {mutant.where}: {mutant.before}  ->  {mutant.after}"
            print(f"[{counts.total():3}/{len(mutants)}] {outcome:9} {said}", flush=True)
    print(dict(counts))


if __name__ == "__main__":
    main()
