"""Options that several commands share, and where their results are written."""

from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, cast

import typer
from rich.console import Console

from supersampler.errors import ArgumentError
from supersampler.io.atomic import check_ours
from supersampler.model import ExecutorName
from supersampler_bench.markdown_blocks import find_block, update_blocks
from supersampler_bench.record import Record, is_record, setting, write_json

ERRORS = Console(stderr=True, highlight=False)


def _checked_json(path: Path | None) -> Path | None:
    """Fail now, not after minutes, where a file that is no record has this name."""
    if path is not None:
        check_ours(path, is_record, "a record of `bench ... --json`")
    return path


JSON = Annotated[
    Path | None, typer.Option(help="Write all values and their setting here.", callback=_checked_json)
]
UPDATE = Annotated[
    Path | None, typer.Option(help="Rewrite the tables between this Markdown file's bench marks.")
]

Tables = Mapping[str, Callable[[Record], str]]
"""What makes each table of a record, by the name of its block."""


def warn(text: str) -> None:
    """Print a warning."""
    ERRORS.print(f"warning: {text}", style="yellow", soft_wrap=True, markup=False)


def listed(text: str) -> list[str]:
    """Return the parts of a text with commas between."""
    return [part.strip() for part in text.split(",")]


def parse_executors(text: str) -> list[ExecutorName]:
    """Return the executors of an option.

    Raises:
        ArgumentError: one of them is none.
    """
    kinds = listed(text)
    if not set(kinds) <= {"cpu", "onnx"}:
        raise ArgumentError("--executors", got=repr(text), want="cpu, onnx or cpu,onnx")
    return [cast("ExecutorName", kind) for kind in kinds]


def check_page(page: Path | None, names: Iterable[str]) -> None:
    """Fail now, not after minutes, where a page lacks one of the blocks that are to be written.

    Raises:
        ArgumentError: it does.
    """
    if page is not None:
        for name in names:
            find_block(page, name)


def publish(
    measured: Mapping[str, Any],
    tables: Tables,
    json: Path | None,
    page: Path | None,
    *,
    page_only: Collection[str] = (),
) -> None:
    """Print the tables of what was measured; write the record to `json`, the tables to the page.

    Args:
        measured: all values, ready for JSON.
        tables: of the record.
        json: of the record; None writes none.
        page: has the blocks of the tables; None writes none.
        page_only: names of tables that are not printed.
    """
    record = {**measured, **setting()}
    texts = {name: make(record) for name, make in tables.items()}
    printed = [text for name, text in texts.items() if name not in page_only]
    Console().print("\n\n".join(printed), markup=False, soft_wrap=True)
    if json is not None:
        write_json(record, json)
    if page is not None:
        update_blocks(page, texts)
