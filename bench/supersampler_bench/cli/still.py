"""`supersampler bench still`: methods before a camera that stands."""

from typing import Annotated

import typer
from rich.progress import Progress

from supersampler.cli.arguments import parse_size, parse_skip
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import (
    ERRORS,
    JSON,
    UPDATE,
    check_page,
    listed,
    parse_executors,
    publish,
)


def still(
    scenes: Annotated[
        str, typer.Option(help="analytic, or families of test shots; NAME-mover with moving objects.")
    ] = "analytic,analytic-mover,court,gallery-mover",
    methods: Annotated[
        str, typer.Option(help="Shipped models or model folders, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    ratios: Annotated[str, typer.Option(help="Display over render size.")] = "1,1.5,2,3",
    display_size: Annotated[str, typer.Option(help="Of the images.")] = "320x180",
    executor: Annotated[str, typer.Option(help="cpu or onnx.")] = "cpu",
    skip: Annotated[str, typer.Option(help="exact, auto or a number.")] = "auto",
    samples: Annotated[int, typer.Option(min=1, help="A pixel of the test shots' references.")] = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure images of scenes that stand still, after 1, 2 and 4 jitter periods, and the time of a frame.

    Test shots are rendered here, with OpenGL. Quiet machines measure time well: nothing else should run.

    Example:
      supersampler bench still --scenes analytic --ratios 2 --update README.md
    """
    from supersampler_bench.quality.still import (
        SCENES,
        frame_count,
        markdown_table,
        measure_still,
        still_record,
    )

    tables = {"still": markdown_table}
    check_page(update, tables)
    names, size = listed(scenes), parse_size(display_size)
    if not set(names) <= set(SCENES):
        raise ArgumentError("--scenes", got=repr(scenes), want=", ".join(SCENES))
    kind, values = parse_executors(executor)[0], [float(text) for text in listed(ratios)]
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=len(names) * sum(map(frame_count, values)))
        results = measure_still(
            names,
            listed(methods),
            size,
            ratios=values,
            executor=kind,
            skip=parse_skip(skip),
            samples=samples,
            on_frame=lambda: progress.advance(task),
        )
    publish(still_record(results, size, kind, parse_skip(skip)), tables, json, update)
