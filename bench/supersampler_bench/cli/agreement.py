"""`supersampler bench ...` parity, precision and compare: whether runs, precisions and records agree."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import (
    ERRORS,
    JSON,
    UPDATE,
    check_page,
    listed,
    publish,
)
from supersampler_bench.record import read_record


def parity(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    frames: Annotated[int, typer.Option(min=10, help="That follow from one another.")] = 200,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare the ONNX and CPU backends with torch, over a long sequence that is rendered here, with OpenGL.

    Example:
      supersampler bench parity --methods classifier --frames 300 --update docs/results/backends.md
    """
    from supersampler_bench.agreement.parity import (
        markdown_table,
        measure_parity,
        methods_by_size,
        parity_record,
    )

    tables = {"parity": markdown_table}
    check_page(update, tables)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=len(methods_by_size(listed(methods))) * frames)
        results = measure_parity(listed(methods), frames, on_frame=lambda: progress.advance(task))
    publish(parity_record(results), tables, json, update)


def precision(
    scenes: Annotated[
        str, typer.Option(help="Families of test shots, with commas between.")
    ] = "machine_hall,market,night_garden,gallery,court",
    methods: Annotated[
        str, typer.Option(help="Names of shipped models that are learned, with commas between.")
    ] = "classifier,classifier-small",
    display_size: Annotated[str, typer.Option(help="Of the images.")] = "320x180",
    frames: Annotated[int, typer.Option(min=30, help="That follow from one another.")] = 300,
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    samples: Annotated[int, typer.Option(min=1, help="A pixel of the references.")] = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure what coarser precisions cost at the end of long sequences, rendered here, with OpenGL.

    Example:
      supersampler bench precision --scenes court --methods classifier --update docs/results/backends.md
    """
    from supersampler_bench.quality.precision import markdown_table, measure_precision, precision_record

    tables = {"precision": markdown_table}
    check_page(update, tables)
    families, size = listed(scenes), parse_size(display_size)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=len(families) * frames)
        results = measure_precision(
            families,
            listed(methods),
            size,
            frames,
            ratio=ratio,
            samples=samples,
            on_frame=lambda: progress.advance(task),
        )
    publish(precision_record(results, size, frames, ratio), tables, json, update)


def compare(
    before: Annotated[Path, typer.Argument(help="A file of `bench ... --json`.")],
    after: Annotated[Path, typer.Argument(help="One of the same bench, later.")],
    above: Annotated[
        float,
        typer.Option(min=0.0, help="What is worse by less is left out: dB, or a share."),
    ] = 0.01,
) -> None:
    """Show what got worse from one record to the next, worst first; fails where something did.

    Example:
      supersampler bench compare bench/results/quality-plaza.json mine.json --above 0.05
    """
    from supersampler_bench.agreement.record_changes import changes, markdown_table

    found = changes(read_record(before), read_record(after))
    if not found:
        want = "some values that are in both"
        raise ArgumentError("records", got="none in common", want=want, hint="Run the same command twice.")
    worse = [change for change in found if change.worse > above]
    Console().print(markdown_table(worse) if worse else "Nothing is worse.", markup=False, soft_wrap=True)
    better = sum(change.worse < -above for change in found)
    ERRORS.print(f"{len(found)} values: {len(worse)} worse, {better} better, by more than {above:g}")
    if worse:
        raise typer.Exit(1)
