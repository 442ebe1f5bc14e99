"""Programs that tests run, and the code of examples that pages show."""

import os
import re
import subprocess
import textwrap
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple


def finished(
    *command: object, folder: Path | None = None, **variables: str
) -> "subprocess.CompletedProcess[str]":
    """Run a program, whatever its exit code will be."""
    environment = {**os.environ, **variables}
    return subprocess.run(
        [str(part) for part in command],
        cwd=folder, env=environment, capture_output=True, text=True, errors="replace", timeout=900,
        check=False,
    )  # fmt: skip


def ran(*command: object, folder: Path | None = None, **variables: str) -> str:
    """Run a program that must succeed, and return what it printed."""
    done = finished(*command, folder=folder, **variables)
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def refused(*command: object) -> str:
    """Run a program that must fail with one line of error, and return that line."""
    done = finished(*command)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
    return done.stderr


class Running(NamedTuple):
    """A running process; zombies are not among them."""

    pid: int
    parent: int
    group: int


def processes() -> list[Running]:
    """Return the processes of this machine that have not ended (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended since
            state, parent, group = stat.read_text().rpartition(")")[2].split()[:3]
            found += [Running(int(stat.parent.name), int(parent), int(group))] if state not in "ZX" else []
    return found


def assert_code_is_of(page: Path, languages: str, files: Iterable[Path], least: int) -> None:
    """Each block of code on a page must be a part of one of the files, but for indentation."""

    def lines(code: str) -> str:
        return "\n".join(line.strip() for line in textwrap.dedent(code).strip().splitlines())

    sources = [lines(file.read_text("utf-8")) for file in files]
    snippets = re.findall(f"```(?:{languages})\n(.*?)```", page.read_text("utf-8"), re.DOTALL)
    assert len(snippets) >= least
    for snippet in snippets:
        assert any(lines(snippet) in source for source in sources), snippet
