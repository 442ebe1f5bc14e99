"""Tables of README.md and docs/**/*.md from the records in bench/results; the commands that measure these."""

import re
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler.io.files import is_there, replacing
from supersampler_bench import parity  # noqa: F401  # each module registers its record
from supersampler_bench import record as bench_record
from supersampler_bench.quality import denoise_record, extrapolation, score_table, still, three_js  # noqa: F401
from supersampler_bench.stress import runner  # noqa: F401
from supersampler_bench.timing import gpu_record, latency, pareto, skip, startup, traffic, views  # noqa: F401

RESULTS = Path("bench/results")
"""Folder of the records of published numbers, in the repository."""
COMMANDS = Path("bench/records.toml")
_PAPER = Path("out/classifier-paper")
_EXPORT = f"export classifier-paper --weights bench/weights/classifier-paper.safetensors -o {_PAPER}"


def blocks_of(name: str, record: bench_record.JsonRecord) -> dict[str, str]:
    """Return the tables of a record by the names of their blocks; `name` is that of the record's file.

    The table "clip" of "quality-plaza" is the block "quality plaza clip".
    """
    if (kind := bench_record.BENCHES.get(record["bench"])) is None:
        return {}
    return dict(zip(kind.block_names(name.replace("-", " ", 1)), kind.TABLES, strict=True))


def block_text(record: bench_record.JsonRecord, table: str) -> str:
    """Return the text of a block; a last line names the models that have changed since its record.

    Raises:
        ArgumentError: another version wrote the record.
    """
    text = bench_record.BenchRecord.from_json(record).table_text(table)
    age = bench_record.age_of(record)
    return f"{text}\n\n{age}" if age else text


def read_records(folder: Path) -> dict[str, bench_record.JsonRecord]:
    """Return all records of a folder, by the names of their files.

    Raises:
        ArgumentError: there is none, or a file is not a record.
    """
    records: dict[str, bench_record.JsonRecord] = {
        path.stem: bench_record.read_record(path) for path in sorted(folder.glob("*.json"))
    }
    if not records:
        hint = "Run it in the repository, or say where records of `bench ... --json` are."
        raise ArgumentError("results", got=f"{folder} without records", want="a folder of records", hint=hint)
    return records


@dataclass(frozen=True)
class DocBlock:
    """One block of a Markdown file, compared with its record."""

    page: Path
    name: str
    text: str  # at present
    recorded: str | None  # made from its record; None without a record of this version
    problem: str = ""  # why there is none

    @property
    def is_recorded(self) -> bool:
        """Whether the text equals the record's; without a record it must be empty."""
        return self.text == (self.recorded or "")

    def write(self) -> None:
        """Write the text of the record, if there is one."""
        if self.recorded is not None and not self.is_recorded:
            update_block(self.page, self.name, self.recorded)


def find_all(root: Path) -> Iterator[DocBlock]:
    """Yield all blocks of README.md and docs/**/*.md of a repository.

    Raises:
        ArgumentError: there are no records, one is damaged, or a page has a block twice.
    """
    records = read_records(root / RESULTS)
    if (pareto_path := root / "bench" / "supersampler_bench" / bench_record.SHIPPED_PARETO.name).is_file():
        records["pareto"] = bench_record.read_record(pareto_path)
    tables = {
        block: (record, table)
        for name, record in records.items()
        for block, table in blocks_of(name, record).items()
    }
    for page in (root / "README.md", *sorted((root / "docs").rglob("*.md"))):
        for name in re.findall(r"<!-- bench:(.+?) -->", page.read_text(encoding="utf-8")):
            yield _block(page, name, tables.get(name))


def _block(page: Path, name: str, recorded: tuple[bench_record.JsonRecord, str] | None) -> DocBlock:
    content, start, stop = find_block(page, name)
    text = content[start:stop].replace("\r\n", "\n").strip("\n")
    if recorded is None:
        return DocBlock(page, name, text, None, "there is no record of it")
    try:
        return DocBlock(page, name, text, block_text(*recorded))
    except ArgumentError as error:
        return DocBlock(page, name, text, None, str(error))


@dataclass(frozen=True)
class Recipe:
    """Command that measures a record."""

    name: str  # of the record's file, without the suffix
    command: str  # as one types it, without --json
    record: bench_record.JsonRecord | None  # the present one

    @property
    def problem(self) -> str:
        """Reason why it has to be measured; "" where nothing has changed since."""
        if self.record is None:
            return "was never measured"
        given = shlex.join(self.record.get("command", ()))
        if re.sub(r" --json[ =]\S+", "", given) != shlex.join(shlex.split(self.command)):
            return "was measured by another command"
        return bench_record.age_of(self.record)

    @property
    def seconds(self) -> float:
        """Duration of the last measurement; 0 where that is not known."""
        return float((self.record or {}).get("seconds", 0.0))


class _Recipes(msgspec.Struct):
    commands: dict[str, str]


def recipes(root: Path, names: Sequence[str] = ()) -> Iterator[Recipe]:
    """Yield the recipes of a repository, of some records by name or of all, in the order of the file.

    Raises:
        ArgumentError: there is no such file, or it has no such record.
    """
    try:
        commands = msgspec.toml.decode((root / COMMANDS).read_bytes(), type=_Recipes).commands
    except (OSError, msgspec.MsgspecError) as error:
        want = "a repository of supersampler"
        raise ArgumentError("root", got=f"{root} ({error})", want=want) from error
    if unknown := [name for name in names if name not in commands]:
        raise ArgumentError("records", got=", ".join(unknown), want=f"some of {', '.join(commands)}")
    for name in names or commands:
        path = root / RESULTS / f"{name}.json"
        yield Recipe(name, commands[name], bench_record.read_record(path) if is_there(path) else None)


def measure(root: Path, recipe: Recipe, on_line: Callable[[str], None]) -> bool:
    """Run a recipe's command in the repository; return whether it succeeded. `on_line` gets its errors.

    The record is replaced only if it succeeds. Published records have no scores of single frames.
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
    record = bench_record.read_record(root / path)
    if record["bench"] == score_table.QualityRecord.BENCH:
        bench_record.write_json(score_table.QualityRecord.from_json(record).without_frames(), root / path)
    return True


def clock(seconds: float) -> str:
    """Return a duration as "1 h 05 min" or "40 s"."""
    minutes = round(seconds / 60)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"


def update_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- bench:NAME -->` and `<!-- /bench -->`, atomically; see `find_block`."""
    content, start, stop = find_block(path, name)
    end = "\r\n" if "\r\n" in content else "\n"
    inner = end.join(["", *text.split("\n"), ""])
    with replacing(path) as partial:
        partial.write_text(content[:start] + inner + content[stop:], encoding="utf-8", newline="")


def find_block(path: Path, name: str) -> tuple[str, int, int]:
    """Return the text of a Markdown file, and the start and end of the block `name` in it.

    Raises:
        ArgumentError: the file cannot be read, or does not have exactly one such block.
    """
    opening, closing = f"<!-- bench:{name} -->", "<!-- /bench -->"
    try:
        with path.open(encoding="utf-8", newline="") as file:  # newline="": line ends stay as they are
            content = file.read()
    except OSError as error:
        raise ArgumentError("update", got=f"{path} ({error})", want="a Markdown file") from error
    found = list(re.finditer(f"(?<={re.escape(opening)}).*?(?={re.escape(closing)})", content, re.DOTALL))
    if len(found) != 1:
        got = f"{path} with {len(found)} blocks of {name!r}"
        hint = f"Write the lines {opening} and {closing} where the table should stand."
        raise ArgumentError("update", got=got, want="one", hint=hint)
    return content, *found[0].span()
