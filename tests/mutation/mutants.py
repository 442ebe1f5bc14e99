"""Mutants of a source file: each replaces one expression or statement, and leaves the rest unchanged."""

import ast
import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

Text = Callable[[ast.expr | ast.stmt], str]
"""Source text of a node."""

NEGATED: dict[type[ast.cmpop], str] = {
    ast.Lt: ">=", ast.LtE: ">", ast.Gt: "<=", ast.GtE: "<", ast.Eq: "!=", ast.NotEq: "==",
    ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
}  # fmt: skip
SHIFTED: dict[type[ast.cmpop], str] = {ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">"}
SWAPPED: dict[type[ast.operator], str] = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Mod: "*", ast.Pow: "*",
    ast.BitAnd: "|", ast.BitOr: "&", ast.LShift: ">>", ast.RShift: "<<",
}  # fmt: skip
SIGNS: dict[type[ast.operator], str] = {
    ast.Sub: "-", ast.Div: "/", ast.FloorDiv: "//", ast.Mod: "%", ast.Pow: "**",
}  # fmt: skip
"""Operators whose operands may change places."""
OPPOSITES = [
    ("minimum", "maximum"), ("min", "max"), ("any", "all"), ("floor", "ceil"), ("sin", "cos"),
    ("zeros", "ones"), ("zeros_like", "ones_like"), ("sum", "mean"),
]  # fmt: skip
OPPOSITE = {**dict(OPPOSITES), **{b: a for a, b in OPPOSITES}}
DROPPED = {"clamp", "clip", "abs", "floor", "round", "sqrt", "square", "detach", "exp", "log"}
"""Methods whose result can stand in for what they are called on, and the other way round."""
UNORDERED = {
    "minimum",
    "maximum",
    "min",
    "max",
    "isinstance",
    "zip",
    "isclose",
    "logical_and",
    "logical_or",
    "add",
    "multiply",
    "gcd",
}
"""Functions whose first two arguments may change places, or fail at once if they do."""
UNSEEN_KEYWORDS = {"copy", "device", "strict", "slots", "frozen"}
"""Keywords that change no value on this machine unless there is another error."""
SILENT = ("Error", "Warning", "warn", "cast", "TypeVar")
"""Suffixes of calls that only build messages or inform the type checker."""
GUARD = 1e-4
"""Smaller numbers guard divisions; no test can notice another value."""


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        path: path of the file, relative to the root of the repository.
        line: line number of the change; the first line is 1.
        lines: first and last line of the statement that contains the change.
        on_import: whether this statement runs when the module is imported.
        where: qualified name of the function or class around it; empty at module level.
        start, end: range of bytes that is replaced.
        new: text that replaces it.
        before, after: the changed lines, joined to one line without indentation.
    """

    path: str
    line: int
    lines: tuple[int, int]
    on_import: bool
    where: str
    start: int
    end: int
    new: str
    before: str
    after: str

    def is_change(self, source: bytes) -> bool:
        """Return whether the changed file parses, and differs from the original."""
        try:
            return ast.dump(ast.parse(self.applied(source))) != ast.dump(ast.parse(source))
        except SyntaxError:
            return False

    def applied(self, source: bytes) -> bytes:
        """Return the file's text with the change."""
        return source[: self.start] + self.new.encode() + source[self.end :]


def mutants_of(path: str, source: bytes) -> list[list[Mutant]]:
    """Return the mutants of a file, place by place."""
    finder = _Finder(path, source)
    finder.visit(ast.parse(source))
    return [place for place in finder.places if place]


def sample(places: list[list[Mutant]], seed: int) -> Iterator[Mutant]:
    """Yield one mutant of each place in random order.

    The order depends on the seed and the code alone: unchanged code keeps it, also in another module.
    """

    def lot(mutant: Mutant) -> bytes:
        said = f"{seed} {mutant.where} {mutant.before} {mutant.after}"
        return hashlib.sha256(said.encode()).digest()

    return iter(sorted((min(place, key=lot) for place in places), key=lot))


class _Finder(ast.NodeVisitor):
    """Walks through the code that runs: no annotations, decorators, texts, or messages of errors."""

    def __init__(self, path: str, source: bytes) -> None:
        self.path, self.source = path, source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.scope: list[str] = []
        self.functions = 0
        self.statement: ast.stmt | None = None
        self.places: list[list[Mutant]] = []
        self.unsigned: set[ast.expr] = set()

    def visit(self, node: ast.AST) -> None:
        """Collect the mutants of `node`, then of its children."""
        if isinstance(node, ast.Call) and _name(node.func).endswith(SILENT):
            return
        outer, self.statement = self.statement, node if isinstance(node, ast.stmt) else self.statement
        if isinstance(node, (ast.expr, ast.stmt)):
            self.unsigned |= _unsigned(node)
            found = [self._mutant(part, new) for part, new in _replacements(node, self._text)]
            self.places.append(
                found[:1] if node in self.unsigned else found
            )  # - for +, not the other way round
        super().visit(node)
        self.statement = outer

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Visit defaults and body."""
        if any(
            "overload" in ast.unparse(d) or "abstractmethod" in ast.unparse(d) for d in node.decorator_list
        ):
            return
        self.scope.append(node.name)
        for default in (*node.args.defaults, *(d for d in node.args.kw_defaults if d is not None)):
            self.visit(default)
        self.functions += 1
        for statement in node.body:
            self.visit(statement)
        self._returned(node)
        self.functions -= 1
        self.scope.pop()

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Visit the body alone."""
        self.scope.append(node.name)
        for statement in node.body:
            self.visit(statement)
        self.scope.pop()

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Visit the value alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_keyword(self, node: ast.keyword) -> None:
        """Skip values without effect on this machine."""
        if node.arg not in UNSEEN_KEYWORDS:
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:
        """Skip raised errors."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Skip texts."""

    def _returned(self, node: ast.FunctionDef) -> None:
        """Add mutants that return a default that the annotation allows."""
        kind = ast.unparse(node.returns) if node.returns else ""
        default = "None" if kind.endswith("| None") else {"list": "[]", "dict": "{}"}.get(kind.split("[")[0])
        if default is None:
            return
        for statement in ast.walk(node):
            if isinstance(statement, ast.Return) and statement.value is not None:
                self.statement = statement
                if ast.unparse(statement.value) != default:
                    self.places.append([self._mutant(statement.value, default)])

    def _offset(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._offset(node.lineno, node.col_offset), self._offset(node.end_lineno, node.end_col_offset)

    def _text(self, node: ast.expr | ast.stmt) -> str:
        start, end = self._span(node)
        return self.source[start:end].decode()

    def _mutant(self, node: ast.expr | ast.stmt, new: str) -> Mutant:
        start, end = self._span(node)
        changed = self.source[:start] + new.encode() + self.source[end:]
        assert node.end_lineno is not None
        assert self.statement is not None
        first, last = self.starts[node.lineno - 1], self.starts[node.end_lineno]
        before, after = (
            b" ".join(text.split()).decode()
            for text in (self.source[first:last], changed[first : last + len(changed) - len(self.source)])
        )
        lines = self.statement.lineno, _header_end(self.statement)
        where = ".".join(self.scope)
        return Mutant(
            self.path, node.lineno, lines, not self.functions, where, start, end, new, before, after
        )


def _unsigned(node: ast.AST) -> set[ast.expr]:
    """Differences of which only the size counts, as in abs(a - b)."""
    match node:
        case ast.Call(func=ast.Attribute(value=value, attr="abs" | "square"), args=[]):
            found = [value]
        case ast.Call(func=function, args=[argument]) if _name(function) in {"abs", "square", "norm"}:
            found = [argument]
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=2)):
            found = [left]
        case _:
            found = []
    return {part for part in found if isinstance(part, ast.BinOp) and isinstance(part.op, ast.Sub)}


def _header_end(statement: ast.stmt) -> int:
    """Last line of a statement without the statements in it."""
    body = getattr(statement, "body", None)
    if isinstance(body, list) and body:
        return max(statement.lineno, int(body[0].lineno) - 1)
    return statement.end_lineno or statement.lineno


def _name(node: ast.expr) -> str:
    """Last part of a dotted name."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _replacements(node: ast.expr | ast.stmt, text: Text) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Yield what may stand in for `node` or for a part of it."""
    match node:
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            for table in (NEGATED, SHIFTED if isinstance(right, ast.Constant) else {}):
                if type(op) in table:
                    yield node, f"({text(left)} {table[type(op)]} {text(right)})"
        case ast.BinOp(left=left, op=op, right=right) if not isinstance(left, ast.JoinedStr):
            if type(op) in SWAPPED:
                yield node, f"(({text(left)}) {SWAPPED[type(op)]} ({text(right)}))"
            if type(op) in SIGNS:
                yield node, f"(({text(right)}) {SIGNS[type(op)]} ({text(left)}))"
        case ast.BoolOp(op=op, values=values):
            yield (
                node,
                "("
                + (" or " if isinstance(op, ast.And) else " and ").join(f"({text(v)})" for v in values)
                + ")",
            )
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield node, f"({text(operand)})"
        case ast.Constant(value=value):
            yield from ((node, new) for new in _other_constants(value))
        case ast.Slice(lower=lower, upper=upper):
            bounds = [b for b in (lower, upper) if b is not None and not isinstance(b, ast.Constant)]
            yield from ((bound, f"({text(bound)} + 1)") for bound in bounds)
        case ast.Call():
            yield from ((node, new) for new in _other_calls(node, text))
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            if not isinstance(test, (ast.Compare, ast.UnaryOp)):  # which have mutants of their own
                yield test, f"(not ({text(test)}))"
        case ast.AugAssign(target=target, op=op, value=value):
            yield node, "pass"
            if type(op) in SWAPPED:
                yield node, f"{text(target)} {SWAPPED[type(op)]}= {text(value)}"
        case ast.Raise() | ast.Expr(value=ast.Call()):
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


def _other_calls(node: ast.Call, text: Text) -> Iterator[str]:
    name, callee = _name(node.func), text(node.func)
    arguments = [text(a) for a in node.args]
    keywords = [(k.arg, f"{k.arg}={text(k.value)}" if k.arg else f"**{text(k.value)}") for k in node.keywords]

    def call(function: str, arguments: list[str], keywords: list[tuple[str | None, str]]) -> str:
        return f"{function}({', '.join([*arguments, *(k for _, k in keywords)])})"

    if len(arguments) > 1 and arguments[0] != arguments[1] and name not in UNORDERED:
        yield call(callee, [arguments[1], arguments[0], *arguments[2:]], keywords)
    if name in OPPOSITE:
        yield call(callee[: -len(name)] + OPPOSITE[name], arguments, keywords)
    if name in DROPPED and isinstance(node.func, ast.Attribute) and not arguments[1:]:
        owner = node.func.value
        if not (isinstance(owner, ast.Name) and owner.id in {"np", "torch", "math"}):
            yield f"({text(owner)})"
    for keyword in node.keywords if name not in DROPPED else []:
        if isinstance(keyword.value, ast.Constant) and keyword.arg not in UNSEEN_KEYWORDS:
            yield call(callee, arguments, [k for k in keywords if k[0] != keyword.arg])
