"""Measure the records of the repository again, by the commands of bench/records.toml."""

import shlex
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler.io.files import is_there
from supersampler_bench.quality.score_record import summaries_of
from supersampler_bench.record import Record, age_of, read_record, write_json
from supersampler_bench.report.doc_tables import RESULTS

COMMANDS = Path("bench/records.toml")
_PAPER = Path("out/classifier-paper")
_EXPORT = f"export classifier-paper --weights bench/weights/classifier-paper.safetensors -o {_PAPER}"


@dataclass(frozen=True)
class Recipe:
    """How a record is measured.

    Attributes:
        name: of the record's file, without the suffix.
        command: as one types it, without --json.
        record: the present one; None where there is none.
    """

    name: str
    command: str
    record: Record | None

    @property
    def problem(self) -> str:
        """Return why it has to be measured; "" where nothing has changed since."""
        if self.record is None:
            return "was never measured"
        words = shlex.split(self.command)
        if [word for word in self.record["command"] if word in words] != words:
            return "was measured by another command"
        return age_of(self.record)

    @property
    def seconds(self) -> float:
        """Return how long it took the last time; 0 where that is not known."""
        return float((self.record or {}).get("seconds", 0.0))


def recipes(root: Path, names: Sequence[str] = ()) -> Iterator[Recipe]:
    """Return the recipes of a repository, in the order of the file.

    Args:
        root: the repository.
        names: of records; none are all.

    Raises:
        ArgumentError: there is no such file, or it has no such record.
    """
    try:
        commands = tomllib.loads((root / COMMANDS).read_text(encoding="utf-8"))["commands"]
    except (OSError, KeyError, tomllib.TOMLDecodeError) as error:
        want = "a repository of supersampler"
        raise ArgumentError("root", got=f"{root} ({error})", want=want) from error
    if unknown := [name for name in names if name not in commands]:
        raise ArgumentError("records", got=", ".join(unknown), want=f"some of {', '.join(commands)}")
    for name in names or commands:
        path = root / RESULTS / f"{name}.json"
        yield Recipe(name, commands[name], read_record(path) if is_there(path) else None)


def measure(root: Path, recipe: Recipe, on_line: Callable[[str], None]) -> bool:
    """Run a recipe's command; its record is replaced when that has ended well, by summaries alone.

    Args:
        root: the repository.
        recipe: what to measure.
        on_line: called with what went wrong.

    Returns:
        Whether it ended well.
    """
    path = RESULTS / f"{recipe.name}.json"
    steps = [f"{recipe.command.removeprefix('supersampler ')} --json {path}"]
    if str(_PAPER) in recipe.command and not is_there(root / _PAPER):
        steps.insert(0, _EXPORT)
    for step in steps:
        done = run([sys.executable, "-m", "supersampler", *shlex.split(step)], seconds=None, folder=root)
        if done.returncode:
            on_line(done.stderr.decode(errors="replace").strip() or f"code {done.returncode}")
            return False
    record = read_record(root / path)
    if record["bench"] == "quality":
        write_json(summaries_of(record), root / path)
    return True


def clock(seconds: float) -> str:
    """Return a duration as "1 h 05 min" or "40 s"."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def timed(work: Callable[[], bool]) -> tuple[bool, float]:
    """Return what a function returns, and the seconds that it took."""
    began = time.perf_counter()
    return work(), time.perf_counter() - began
