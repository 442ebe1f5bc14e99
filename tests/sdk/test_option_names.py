"""Tests of option names: a message names only options that its command has; one thing has one name."""

import ast
import itertools
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest
import typer

from supersampler.cli import app
from supersampler.cli.app import TOOLS

ROOT = Path(__file__).parents[2]
FOLDERS = {"supersampler": "sdk", "supersampler_model": "model", "supersampler_export": "export",
           "supersampler_bench": "bench"}  # fmt: skip
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
QUOTED = re.compile(r"`(?:supersampler )?([^`]*--[^`]*)`?")
NEVER_SAID = {
    ("bench report", "--only"): "it runs all quick scenarios",
    ("bench startup", "--against"): "it times this version",
    **dict.fromkeys(
        itertools.product(("bench records", "bench report"), ("--json", "--weights")),
        "`bench records` gives it to other commands",
    ),
}
"""Options in messages that a command reaches and cannot say, and why."""
OTHERS = {"--collect-all"}
"""Options of other programs."""


class Command(NamedTuple):
    """Where the function of a command is, and its options."""

    module: str
    function: str
    options: frozenset[str]


@cache
def commands() -> dict[str, Command]:
    """All commands, those of groups as "bench quality"."""
    found: dict[str, Command] = {}
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        each = typer.main.get_command(import_module(TOOLS[name][0]).app) if name in TOOLS else command
        for sub, one in getattr(each, "commands", {"": each}).items():
            options = frozenset(text for p in one.params for text in (*p.opts, *p.secondary_opts))
            function = one.callback
            found[f"{name} {sub}".strip()] = Command(function.__module__, function.__name__, options)
    return found


class Module:
    """Definitions of a module by name, and what its imports are called there."""

    def __init__(self, path: Path) -> None:
        self.definitions: dict[str, ast.AST] = {}
        tree = ast.parse(path.read_text())
        self.imported = imported(tree.body)
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                self.definitions[node.name] = node
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                self.definitions |= {target.id: node for target in targets if isinstance(target, ast.Name)}


@cache
def module_of(name: str) -> Module | None:
    package, _, rest = name.partition(".")
    base = ROOT / FOLDERS.get(package, "nowhere") / package / rest.replace(".", "/")
    paths = base.with_suffix(".py"), base / "__init__.py"
    return next((Module(path) for path in paths if path.is_file()), None)


def imported(nodes: list[ast.stmt]) -> dict[str, str]:
    """The full names of what statements import."""
    found: dict[str, str] = {}
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            found |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    return found


def definition_of(full: str) -> tuple[str, str] | None:
    """Module and name of a definition, also where a package passes it on."""
    name, _, last = full.rpartition(".")
    module = module_of(name)
    if module is None:
        return None
    if last in module.definitions:
        return name, last
    return definition_of(module.imported[last]) if last in module.imported else None


@cache
def uses(name: str, definition: str) -> frozenset[tuple[str, str]]:
    """The definitions that one uses."""
    module = module_of(name)
    assert module is not None
    node = module.definitions[definition]
    known = {**{own: f"{name}.{own}" for own in module.definitions}, **module.imported}
    known |= imported([each for each in ast.walk(node) if isinstance(each, ast.stmt)])
    fulls = {known[each.id] for each in ast.walk(node) if isinstance(each, ast.Name) and each.id in known}
    fulls |= {
        f"{known[each.value.id]}.{each.attr}"
        for each in ast.walk(node)
        if isinstance(each, ast.Attribute) and isinstance(each.value, ast.Name) and each.value.id in known
    }
    return frozenset(found for full in fulls if (found := definition_of(full)))


def reached(name: str, definition: str) -> set[tuple[str, str]]:
    found: set[tuple[str, str]] = set()
    left = [(name, definition)]
    while left:
        found.add(here := left.pop())
        left += uses(*here) - found
    return found


@cache
def messages(name: str, definition: str) -> tuple[str, ...]:
    """Texts of a definition that name options: no docstrings, no help, no arguments of other programs."""
    module = module_of(name)
    assert module is not None
    node = module.definitions[definition]
    skipped: set[int] = set()
    for each in ast.walk(node):
        if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
            skipped.add(id(each.value))
        elif isinstance(each, ast.Call) and ast.unparse(each.func) in (
            "typer.Option",
            "typer.Argument",
            "_git",
        ):
            skipped |= set(map(id, ast.walk(each)))
        elif isinstance(each, ast.List | ast.Tuple) and len(each.elts) > 2:
            skipped |= set(map(id, each.elts))
        elif isinstance(each, ast.JoinedStr):  # one text, in place of its parts
            skipped |= set(map(id, each.values))
    texts = []
    for each in (each for each in ast.walk(node) if id(each) not in skipped):
        if isinstance(each, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else "NAME" for part in each.values)
            texts.append("".join(map(str, parts)))
        elif isinstance(each, ast.Constant) and isinstance(each.value, str):
            texts.append(each.value)
    return tuple(text for text in texts if OPTION.search(text))


def unknown_options(text: str, own: frozenset[str]) -> Iterator[str]:
    """Options in a message that are not the command's own; in `supersampler NAME ...` that one's."""
    for call in QUOTED.findall(text):
        first, *rest = call.split()
        if first.startswith("-"):
            yield from (option for option in OPTION.findall(call) if option not in own)
            continue
        named = [
            command
            for name, command in commands().items()
            if name.split()[0] == first and (rest[0] == "..." or name.split()[1:] in ([], rest[:1]))
        ]
        options = frozenset().union(*(command.options for command in named))
        yield from (f"{first} {option}" for option in OPTION.findall(call) if option not in options)
    yield from (option for option in OPTION.findall(QUOTED.sub("", text)) if option not in own)


@pytest.mark.parametrize("name", commands())
def test_messages_of_a_command_name_only_options_that_exist(name: str) -> None:
    command = commands()[name]
    wrong = {
        f"{module}.{definition}: {option}"
        for module, definition in reached(command.module, command.function)
        for text in messages(module, definition)
        for option in unknown_options(text, command.options)
        if (name, option) not in NEVER_SAID and option not in OTHERS
    }
    assert not wrong


@pytest.mark.parametrize("option", ["--size", "--sizes", "--ratios", "--provider", "--extrapolation"])
def test_options_have_one_name_in_all_commands(option: str) -> None:
    """Other names are taken: --display-size, --render-size, --ratio, --providers, --extrapolate."""
    others = {"--size": {"train"}, "--sizes": {"bench traffic"}}  # of crops; pairs of sizes
    assert {name for name, command in commands().items() if option in command.options} == others.get(
        option, set()
    )
