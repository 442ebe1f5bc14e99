"""Tests of option names: messages name only options that exist; one thing has one name."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest
import typer

from supersampler.cli import app
from supersampler.cli.app import TOOLS

ROOT = Path(__file__).parents[2]
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
CALL = re.compile(r"`supersampler (\w+)([^`]*)")
OTHERS = {"--help", "--version", "--debug"} | {
    "--abbrev", "--always", "--dirty",  # git
    "--background", "--python", "--python-exit-code",  # Blender
    "--collect-all",  # PyInstaller
}  # fmt: skip
"""Options of the whole command, and of other programs."""


@cache
def commands() -> dict[str, frozenset[str]]:
    """Options of all commands; those of groups are called "bench quality"."""
    found = {}
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        each = typer.main.get_command(import_module(TOOLS[name][0]).app) if name in TOOLS else command
        for sub, one in getattr(each, "commands", {"": each}).items():
            options = (text for p in one.params for text in (*p.opts, *p.secondary_opts))
            found[f"{name} {sub}".strip()] = frozenset(options)
    return found


def messages(file: Path) -> Iterator[str]:
    """Yield the texts of a module that name options; those of f-strings have NAME for each field."""
    tree = ast.parse(file.read_text("utf-8"))
    nodes = list(ast.walk(tree))
    skipped = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(p.value) if isinstance(p, ast.Constant) else "NAME" for p in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in skipped:
            yield node.value


@pytest.mark.parametrize("folder", ["sdk", "model", "export", "bench/supersampler_bench"])
def test_messages_name_only_options_that_exist(folder: str) -> None:
    known = frozenset().union(OTHERS, *commands().values())
    wrong = []
    for file in sorted((ROOT / folder).rglob("*.py")):
        for text in messages(file):
            wrong += [f"{file.name}: {option}" for option in OPTION.findall(text) if option not in known]
            for name, rest in CALL.findall(text):
                own = frozenset().union(*(o for c, o in commands().items() if c.split()[0] == name))
                wrong += [f"{file.name}: {name} {o}" for o in OPTION.findall(rest) if o not in own | OTHERS]
    assert not wrong, wrong


@pytest.mark.parametrize("option", ["--size", "--sizes", "--ratios", "--provider", "--extrapolation"])
def test_options_have_one_name_in_all_commands(option: str) -> None:
    """Other names are in use: --display-size, --render-size, --ratio, --providers, --extrapolate."""
    others = {"--size": {"train"}}  # of crops
    assert {name for name, options in commands().items() if option in options} == others.get(option, set())
