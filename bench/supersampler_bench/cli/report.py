"""`supersampler bench tables` and `report`: all records as Markdown tables and as one HTML page."""

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
    of the shipped shot, speed, one against the other, parity, stress.

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
