"""`supersampler bench ...` parity, precision and compare: whether runs, precisions and records agree."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    JSON,
    METHODS,
    ONE_RATIO,
    SAMPLES,
    SCENES,
    UPDATE,
    check_page,
    counted,
    listed,
    publish,
    say,
)
from supersampler_bench.record import read_record

FRAMES = "That follow from one another."


def parity(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    frames: Annotated[int, typer.Option(min=10, help=FRAMES)] = 200,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare the ONNX and CPU backends with torch, over a long sequence that is rendered here, with OpenGL.

    Example:
      supersampler bench parity --methods classifier --frames 300 --update docs/results/backends.md
    """
    from supersampler_bench.agreement import parity as bench

    tables = {"parity": bench.markdown_table}
    check_page(update, tables)
    names = listed(methods)
    with counted("frames", len(bench.methods_by_size(names)) * frames) as advance:
        results = bench.measure_parity(names, frames, on_frame=advance)
    publish(bench.parity_record(results), tables, json, update)


def precision(
    scenes: SCENES = "machine_hall,market,night_garden,gallery,court",
    methods: METHODS = "classifier,classifier-small",
    display_size: DISPLAY_SIZE = "320x180",
    frames: Annotated[int, typer.Option(min=30, help=FRAMES)] = 300,
    ratio: ONE_RATIO = 2.0,
    samples: SAMPLES = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure what coarser precisions cost at the end of long sequences, rendered here, with OpenGL.

    Example:
      supersampler bench precision --scenes court --methods classifier --update docs/results/backends.md
    """
    from supersampler_bench.quality import precision as bench

    tables = {"precision": bench.markdown_table}
    check_page(update, tables)
    families, size = listed(scenes), parse_size(display_size)
    with counted("frames", len(families) * frames) as advance:
        results = bench.measure_precision(
            families, listed(methods), size, frames, ratio=ratio, samples=samples, on_frame=advance
        )
    publish(bench.precision_record(results, size, frames, ratio), tables, json, update)


def compare(
    before: Annotated[Path, typer.Argument(help="A file of `bench ... --json`.")],
    after: Annotated[Path, typer.Argument(help="One of the same bench, later.")],
    above: Annotated[
        float, typer.Option(min=0.0, help="Leave out what is worse by less: dB, or a fraction.")
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
    say(f"{len(found)} values: {len(worse)} worse, {better} better, by more than {above:g}")
    if worse:
        raise typer.Exit(1)
