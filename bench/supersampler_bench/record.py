"""Records: values of a measurement with machine, versions, models, date and command, as JSON and tables."""

import hashlib
import json
import math
import platform
import re
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any, ClassVar, Self, TypeAlias

import msgspec

from supersampler.backends.cpu.library import VERSION
from supersampler.cli.arguments import size_text
from supersampler.denoising import spec as denoising_spec
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.child_process import run
from supersampler.io.files import replacing
from supersampler.io.machine import installed_versions, machine
from supersampler.io.shot.format import FILE_NAME as SHOT_FILE
from supersampler.io.shot.shot import SHIPPED
from supersampler.methods.model_file import extrapolation_names, model_names, shipped_model

JsonRecord: TypeAlias = Mapping[str, Any]
"""A record as JSON: of any bench, of this version or another."""

SHIPPED_PARETO = Path(__file__).parent / "pareto.json"
"""Record of the times and scores of the shipped methods, from which presets are chosen."""
DENOISER = "temporal-denoiser"
"""Name of the temporal denoiser in records."""
_BEGAN = time.monotonic()  # approximate start of a command
_IMAGE_FILES = ("step.onnx", "network.npz")
"""Files of a model that determine its images; model.json has their hashes."""
_PACKAGES = ("supersampler", "numpy", "onnxruntime", "flip-evaluator", "pyoidn")


@dataclass(frozen=True)
class Provenance:
    """Provenance of a measurement."""

    commit: str | None = None  # of the repository; None outside a repository
    model_digests: dict[str, str] | None = None  # see the function; None in older records
    versions: dict[str, str | None] = field(default_factory=dict)  # of Python and packages
    machine: dict[str, Any] = field(default_factory=dict)  # processor, cores and operating system
    command: list[str] = field(default_factory=list)
    date: str = ""  # UTC
    seconds: float = 0.0  # duration of the command

    @classmethod
    def now(cls) -> "Provenance":
        """Return the provenance of this process."""
        return cls(
            commit=_commit(),
            model_digests=dict(model_digests()),
            versions={"python": platform.python_version(), **installed_versions(*_PACKAGES)},
            machine=machine(),
            command=["supersampler", *sys.argv[1:]],
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            seconds=round(time.monotonic() - _BEGAN, 1),
        )


_PROVENANCE = tuple(Provenance.__dataclass_fields__)


@dataclass(frozen=True)
class BenchRecord:
    """Values of one measurement, and their tables. A subclass has the values of one bench as fields."""

    provenance: Provenance = field(default_factory=Provenance.now, kw_only=True)
    quick: bool = field(default=False, kw_only=True)  # whether few frames make the numbers rough
    BENCH: ClassVar[str] = ""
    TABLES: ClassVar[tuple[str, ...]] = ("",)
    """Names of the Markdown tables: "" is made by `table`, "summary" by `summary_table`, and so on."""

    def __init_subclass__(cls) -> None:
        if cls.BENCH:
            BENCHES[cls.BENCH] = cls

    @classmethod
    def block_names(cls, name: str) -> list[str]:
        """Return the names of the record's blocks in Markdown files, as "latency" and "latency summary"."""
        return [f"{name} {table}".rstrip() for table in cls.TABLES]

    def tables(self, name: str) -> dict[str, str]:
        """Return the Markdown of each block by its name."""
        return dict(zip(self.block_names(name), map(self.table_text, self.TABLES), strict=True))

    def table_text(self, table: str) -> str:
        """Return the Markdown of one of TABLES."""
        return str(getattr(self, f"{table}_table".lstrip("_"))())

    @property
    def machine_name(self) -> str:
        """The processor and the number of its cores."""
        return f"{self.provenance.machine['cpu']}, {self.provenance.machine['cores']} cores"

    def to_json(self) -> dict[str, Any]:
        """Return all values for JSON."""
        values = asdict(self)
        provenance = values.pop("provenance")
        return {"bench": self.BENCH, **values, **provenance}

    @classmethod
    def adapted(cls, data: JsonRecord) -> JsonRecord:
        """Return a JSON record with the types of the fields."""
        return data

    @classmethod
    def from_json(cls, data: JsonRecord) -> Self:
        """Return the record of values by `to_json`.

        Raises:
            ArgumentError: they are of another bench, or of another version.
        """
        kind = BENCHES.get(data["bench"], cls)
        provenance = {name: data[name] for name in _PROVENANCE if name in data}
        try:
            record = msgspec.convert({**kind.adapted(data), "provenance": provenance}, kind)
        except (msgspec.ValidationError, LookupError, TypeError) as error:
            got = f"without {error}" if isinstance(error, LookupError) else str(error)
            hint = "Measure again: the record has the command."
            raise ArgumentError("record", got=got, want="one of this version", hint=hint) from error
        if not isinstance(record, cls):
            raise ArgumentError("record", got=f"one of {data['bench']!r}", want=f"one of {cls.BENCH!r}")
        return record


BENCHES: dict[str, type[BenchRecord]] = {}
"""Types of records by the name of their bench, each added when its module is imported."""


@cache
def model_digests() -> Mapping[str, str]:
    """Return a digest of each shipped model and of DENOISER, which changes if their images may change."""
    texts = {}
    for name in (*model_names(), *extrapolation_names()):
        files = json.loads((shipped_model(name) / "model.json").read_text(encoding="utf-8"))["files"]
        texts[name] = "".join(f"{file} {files[file]}\n" for file in _IMAGE_FILES if file in files)
    constants = {name: value for name, value in vars(denoising_spec).items() if name.isupper()}
    texts[DENOISER] = json.dumps({"library": VERSION, **constants}, sort_keys=True)
    return {name: hashlib.sha256(text.encode()).hexdigest()[:16] for name, text in texts.items()}


def age_of(record: JsonRecord) -> str:
    """Return a sentence that names models and shipped shots of a record that have changed since, or ""."""
    now = model_digests()
    texts = _texts({**record, "model_digests": None, "command": None})
    parts = {part for text in texts for part in re.split(r"[\s:+,]+", text)}  # of "taau+guided-warp:x2"
    named = parts & now.keys()
    then = record.get("model_digests")
    when = f"Measured on {str(record.get('date'))[:10]}"
    if then is None:
        return f"{when}, before records named the models' versions." if named else ""
    changed = sorted(name for name in named if then.get(name) != now[name])
    changed += [row["name"] for row in record.get("shots", []) if _is_other_shot(row)]
    at = f" at commit {record['commit'][:8]}" if record.get("commit") else ""
    return f"{when}{at} with another version of {', '.join(changed)}." if changed else ""


def _is_other_shot(row: JsonRecord | str) -> bool:
    """Return whether a shot of a record ships, and has changed since; some records have its name alone."""
    if isinstance(row, str) or not (file := SHIPPED / row.get("name", "") / SHOT_FILE).is_file():
        return False
    return bool(row.get("shot_json_sha256") != hashlib.sha256(file.read_bytes()).hexdigest())


def _texts(values: object) -> Iterator[str]:
    if isinstance(values, str):
        yield values
    elif isinstance(values, Mapping):
        yield from (text for key, value in values.items() for text in (key, *_texts(value)))
    elif isinstance(values, list):
        yield from (text for value in values for text in _texts(value))


def _commit() -> str | None:
    """Return the commit of this package's repository; None outside a repository."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        found = run(command, seconds=10.0, folder=Path(__file__).parent)
    except (OSError, TimeoutExpired):
        return None
    return found.stdout.decode().strip() if found.returncode == 0 else None


def read_record(path: Path) -> dict[str, Any]:
    """Return a record that a bench command wrote with `--json`.

    Raises:
        ArgumentError: the file is not such a record.
    """
    reason = ""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(record["bench"], str):
            return dict(record)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        reason = f" ({error})"
    raise ArgumentError("record", got=f"{path}{reason}", want="a file of `bench ... --json`")


def is_record(path: Path) -> bool:
    """Return whether a file is a record that a bench command wrote."""
    try:
        read_record(path)
    except ArgumentError:
        return False
    return True


def write_json(record: BenchRecord | JsonRecord, path: Path) -> None:
    """Write a record atomically; NaN becomes null, because JSON has no NaN.

    Raises:
        ShotError: the file cannot be written.
    """
    values = record.to_json() if isinstance(record, BenchRecord) else record
    text = msgspec.json.encode(values, enc_hook=lambda number: number.item())  # of numpy
    with replacing(path) as partial:
        partial.write_bytes(msgspec.json.format(text, indent=1) + b"\n")


def table(headings: Sequence[str], rows: Iterable[Iterable[object]], caption: str = "") -> str:
    """Return a Markdown table with its caption below; a heading that ends with ":" is aligned right."""
    rule = ["---:" if heading.endswith(":") else "---" for heading in headings]
    lines = [[heading.removesuffix(":") for heading in headings], rule, *rows]
    text = "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)
    return f"{text}\n\n{caption}" if caption else text


def figure(value: float | None, digits: int, unit: str = "") -> str:
    """Return a number with `digits` decimals; a dash for None or NaN."""
    return "–" if value is None or math.isnan(value) else f"{value:.{digits}f}{unit}"


def sizes_text(render: Size, display: Size) -> str:
    """Return "960x540 to 1920x1080"."""
    return f"{size_text(render)} to {size_text(display)}"
