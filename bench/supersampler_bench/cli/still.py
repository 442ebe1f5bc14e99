"""`supersampler bench still`: methods before a camera that stands."""

from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size, parse_skip
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    JSON,
    METHODS,
    SAMPLES,
    UPDATE,
    check_page,
    counted,
    executors_of,
    listed,
    publish,
    words_of,
)


def still(
    scenes: Annotated[
        str, typer.Option(help="analytic, or families of test shots; NAME-mover with moving objects.")
    ] = "analytic,analytic-mover,court,gallery-mover",
    methods: METHODS = "taa,taau,classifier-small,classifier",
    ratios: Annotated[str, typer.Option(help="Display over render size.")] = "1,1.5,2,3",
    display_size: DISPLAY_SIZE = "320x180",
    executor: Annotated[str, typer.Option(help="cpu or onnx.")] = "cpu",
    skip: Annotated[str, typer.Option(help="exact, auto or a number.")] = "auto",
    samples: SAMPLES = 64,
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
    names, size, kind = (
        words_of("--scenes", scenes, SCENES),
        parse_size(display_size),
        executors_of(executor)[0],
    )
    values = [float(text) for text in listed(ratios)]
    with counted("frames", len(names) * sum(map(frame_count, values))) as advance:
        results = measure_still(
            names,
            listed(methods),
            size,
            ratios=values,
            executor=kind,
            skip=parse_skip(skip),
            samples=samples,
            on_frame=advance,
        )
    publish(still_record(results, size, kind, parse_skip(skip)), tables, json, update)
