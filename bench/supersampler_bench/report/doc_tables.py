"""Write the tables of README.md and docs/**/*.md from the records in bench/results."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from supersampler.errors import ArgumentError
from supersampler_bench import parity
from supersampler_bench.markdown_blocks import find_block, update_block
from supersampler_bench.quality import extrapolation, still_table
from supersampler_bench.quality.score_table import block_names, blocks
from supersampler_bench.record import SHIPPED_PARETO, Record, age_of, read_record
from supersampler_bench.stress import report as stress
from supersampler_bench.timing import against, device, device_record, latency, pareto, skip, startup, traffic
from supersampler_bench.timing import network_cost as cost
from supersampler_bench.timing.pareto_extrapolated import unshaded_table
from supersampler_bench.timing.roofline import roofline_table

RESULTS = Path("bench/results")
"""Where the records of published numbers are, in the repository."""
STUDY = "study "
"""Prefix of the blocks that programs in bench/studies write, from records in bench/results/studies."""
Blocks = Mapping[str, Callable[[], str]]
"""Functions that return the text of blocks of a Markdown file, by the block's name."""

_TABLES: Mapping[str, Callable[[Record], str]] = {
    "against": against.markdown_table,
    "cost": cost.markdown_table,
    "device": device.markdown_table,
    "extrapolation": extrapolation.markdown_table,
    "parity": parity.markdown_table,
    "skip": skip.markdown_table,
    "startup": startup.markdown_table,
    "traffic": traffic.markdown_table,
}
"""Functions that make the table of a record, by the record's bench."""


def blocks_of(name: str, record: Record) -> Blocks:
    """Return the blocks that a record fills.

    Args:
        name: of its file, without the suffix: "quality-plaza" is the block "quality plaza".
        record: read from it.
    """
    bench, block = record["bench"], name.replace("-", " ", 1)
    if bench == "quality":
        return {part: partial(_quality_block, record, block, part) for part in block_names(block)}
    if bench == "pareto":
        return {
            block: partial(pareto.markdown_table, record),
            f"{block} unshaded": partial(unshaded_table, record),
            "presets": partial(pareto.preset_table, record),
        }
    if bench == "stress":
        whole = {} if record["quick"] else {f"{block} scenarios": stress.scenario_list}
        return {block: partial(stress.markdown_table, record), **whole}
    if bench == "still":
        return {
            block: partial(still_table.markdown_table, record),
            f"{block} summary": partial(still_table.summary_table, record),
        }
    if bench == device_record.BENCH:
        return {
            block: partial(device_record.step_table, record),
            f"{block} passes": partial(device_record.pass_table, record),
            f"{block} images": partial(device_record.image_table, record),
        }
    if bench == "latency":
        return {
            block: partial(latency.markdown_table, record),
            f"{block} summary": partial(latency.summary_table, record),
        }
    if bench == "traffic":
        return {
            block: partial(traffic.markdown_table, record),
            f"{block} roofline": partial(roofline_table, record),
        }
    return {block: partial(_TABLES[bench], record)} if bench in _TABLES else {}


def _quality_block(record: Record, name: str, part: str) -> str:
    return blocks(record, name)[part]


def block_text(name: str, maker: Callable[[], str]) -> str:
    """Return the text of a block.

    Raises:
        ArgumentError: its record was written by another version.
    """
    try:
        return maker()
    except (KeyError, TypeError) as error:  # a value is missing or unknown in this version
        hint = "Measure again: the record has the command."
        raise ArgumentError("record", got=f"without {error}", want=f"all of {name!r}", hint=hint) from error


def read_records(folder: Path) -> dict[str, Record]:
    """Return all records of a folder, by the names of their files.

    Raises:
        ArgumentError: there is none, or a file is not a record.
    """
    records: dict[str, Record] = {path.stem: read_record(path) for path in sorted(folder.glob("*.json"))}
    if not records:
        hint = "Run it in the repository, or say where records of `bench ... --json` are."
        raise ArgumentError("results", got=f"{folder} without records", want="a folder of records", hint=hint)
    return records


@dataclass(frozen=True)
class Block:
    """One block of a Markdown file, compared with its record.

    Attributes:
        page: the file.
        name: of the block.
        text: its present text.
        wanted: the text that its record gives; None where there is no record of this version.
        problem: why there is none.
    """

    page: Path
    name: str
    text: str
    wanted: str | None
    problem: str = ""

    @property
    def is_recorded(self) -> bool:
        """Whether the text is the one that the record gives; without a record it must be empty."""
        return self.text == (self.wanted or "")


def find_all(root: Path) -> Iterator[Block]:
    """Return all blocks of README.md and docs/**/*.md of a repository.

    Raises:
        ArgumentError: there are no records, one is damaged, or a page has a block twice.
    """
    records = read_records(root / RESULTS)
    if (pareto_path := root / "bench" / "supersampler_bench" / SHIPPED_PARETO.name).is_file():
        records["pareto"] = read_record(pareto_path)
    makers = {
        block: partial(_with_age, maker, record)
        for name, record in records.items()
        for block, maker in blocks_of(name, record).items()
    }
    for page in (root / "README.md", *sorted((root / "docs").rglob("*.md"))):
        for name in re.findall(r"<!-- bench:(.+?) -->", page.read_text(encoding="utf-8")):
            if name.startswith(STUDY):
                continue
            yield _block(page, name, makers.get(name))


def _with_age(maker: Callable[[], str], record: Record) -> str:
    """Return the text of a block, which says where models have changed since it was measured."""
    age = age_of(record)
    return f"{maker()}\n\n{age}" if age else maker()


def _block(page: Path, name: str, maker: Callable[[], str] | None) -> Block:
    content, start, stop = find_block(page, name)
    text = content[start:stop].replace("\r\n", "\n").strip("\n")
    if maker is None:
        return Block(page, name, text, None, "there is no record of it")
    try:
        return Block(page, name, text, block_text(name, maker))
    except ArgumentError as error:
        return Block(page, name, text, None, str(error))


def write(block: Block) -> None:
    """Write the text that a block's record gives, if there is one."""
    if block.wanted is not None and not block.is_recorded:
        update_block(block.page, block.name, block.wanted)
