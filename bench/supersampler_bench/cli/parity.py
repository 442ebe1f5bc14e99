"""`supersampler bench parity`: difference of the backends from torch."""

from typing import Annotated

import typer

from supersampler_bench.cli.options import JSON, UPDATE, check_page, counted, listed, publish


def parity(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models, with commas between.")
    ] = "taa,taau,classifier-small,classifier,classifier-large,gbuffer-fast",
    frames: Annotated[int, typer.Option(min=10, help="Consecutive frames at each size.")] = 200,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Compare the ONNX and CPU backends with torch, over a long sequence that is rendered here, with OpenGL.

    \b
    Example:
      supersampler bench parity --methods classifier --frames 300 --update docs/results/backends.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench import parity as bench

    tables = {"parity": bench.markdown_table}
    check_page(update, tables)
    names = listed(methods)
    with counted("frames", len(bench.methods_by_size(names)) * frames) as advance:
        results = bench.measure_parity(names, frames, on_frame=advance)
    publish(bench.parity_record(results), tables, json, update)
