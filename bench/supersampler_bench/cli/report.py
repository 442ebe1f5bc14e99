"""`supersampler bench records`, `tables` and `report`: records anew, as Markdown tables, as one HTML page."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.terminal import Terminal
from supersampler.io.files import check_ours
from supersampler_bench.cli.options import ERRORS, say
from supersampler_bench.record import SHIPPED_PARETO, read_record


def tables(
    root: Annotated[
        Path, typer.Argument(help="The repository: README.md, docs/*.md, bench/results.")
    ] = Path(),
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; fail where a table is not what its record says.")
    ] = False,
) -> None:
    """Rewrite every table of README.md and docs/*.md from the records in bench/results.

    A table whose record is missing, or of another version, is named and left alone.

    \b
    Example:
      supersampler bench tables --check
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.report.doc_tables import find_all, write

    wrong = 0
    for block in find_all(root):
        what = f"{block.page}: {block.name}"
        if block.wanted is None:
            say(f"{what}: left alone: {block.problem}")
        if block.is_recorded:
            continue
        wrong += 1
        if check:
            Terminal().print(f"{what}: is not what its record says", soft_wrap=True)
        elif block.wanted is not None:
            write(block)
            Terminal().print(f"{what}: written", soft_wrap=True)
    if check and wrong:
        raise typer.Exit(1)


def records(
    names: Annotated[list[str] | None, typer.Argument(help="Records of bench/results; none are all.")] = None,
    root: Annotated[Path, typer.Option(help="The repository.")] = Path(),
    list_only: Annotated[
        bool, typer.Option("--list", help="Measure nothing; say what would be, and how long it took last.")
    ] = False,
) -> None:
    """Measure the records of bench/results again whose models or command have changed since.

    Nothing else should run on the machine. A record is replaced when its command has ended well, so that the
    same command continues a stopped run. `supersampler bench tables` writes the tables afterwards.

    \b
    Examples:
      supersampler bench records --list
      supersampler bench records latency quality-plaza
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.report import remeasure

    due = [recipe for recipe in remeasure.recipes(root, names or []) if recipe.problem]
    out = Terminal()
    total, failed = sum(recipe.seconds for recipe in due), 0
    out.print(f"{len(due)} records are due; they took {remeasure.clock(total)}", soft_wrap=True)
    for recipe in due:
        if list_only:
            out.print(f"{recipe.name}: {recipe.problem} ({remeasure.clock(recipe.seconds)})", soft_wrap=True)
            continue
        with ERRORS.status(recipe.name):
            ended, seconds = remeasure.timed(partial(remeasure.measure, root, recipe, say))
        failed += not ended
        out.print(
            f"{recipe.name}: {'measured' if ended else 'failed'}, {remeasure.clock(seconds)}", soft_wrap=True
        )
    if failed:
        raise typer.Exit(1)


def report(
    output: Annotated[Path, typer.Option("-o", "--output", help="The page.")] = Path("report.html"),
    results: Annotated[
        Path | None,
        typer.Option(
            help="Folder of records; with --quick, where they are written.",
            show_default="bench/results; with --quick, beside the page",
        ),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Measure everything briefly first, on this machine.")
    ] = False,
) -> None:
    """Make one HTML page of all records: tables, figures, machine and versions, images side by side.

    The page needs no other file and no network. With --quick it shows rough numbers of this machine: quality
    of the shipped shot, latency, one against the other, parity, stress.

    \b
    Examples:
      supersampler bench report -o report.html
      supersampler bench report --quick -o here.html
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.io.shot import Shot
    from supersampler_bench.report.doc_tables import RESULTS, read_records
    from supersampler_bench.report.image_comparison import split_view
    from supersampler_bench.report.page import is_page, write_page

    check_ours(output, is_page, "a page of `bench report`")
    if quick:
        from supersampler_bench.report.quick_measurements import measure_quickly

        folder = results or output.parent / f"{output.stem}-records"
        measure_quickly(folder, lambda name, message: say(f"{name}: {message}"))
    else:
        folder = results or RESULTS
    records = read_records(folder)
    if not quick and "pareto" not in records and SHIPPED_PARETO.is_file():
        records["pareto"] = read_record(SHIPPED_PARETO)
    with ERRORS.status("writing"):
        write_page(output, records, folder, split_view(Shot.open("plaza")))
    Terminal().print(f"{output}: {', '.join(records)}", soft_wrap=True)
