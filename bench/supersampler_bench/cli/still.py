"""`supersampler bench still`: methods before a fixed camera."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    EXECUTORS,
    JSON,
    METHODS,
    SAMPLES,
    UPDATE,
    Tables,
    counted,
    executors_of,
    listed,
    publish,
    say,
    words_of,
)
from supersampler_bench.markdown_blocks import find_blocks

QUICK_DISPLAY: Size = (96, 54)
TIMED_DISPLAY: Size = (960, 540)
QUICK_RATIO = 1.0  # of the shortest jitter period


def still(
    scenes: Annotated[
        str, typer.Option(help="SCENE:RATIO: analytic, court, or with moving objects, as court-mover.")
    ] = "analytic:1,analytic:1.5,analytic:2,analytic:3,analytic-mover:2,court:2,gallery:2,court-mover:2",
    methods: METHODS = "taa,taau,classifier-small,classifier",
    executors: EXECUTORS = "cpu,onnx",
    display_size: DISPLAY_SIZE = "320x180",
    samples: SAMPLES = 64,
    quick: Annotated[
        bool, typer.Option("--quick", help="Each scene at ratio 1 only, with small images.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for still.png: curves over the frames.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure images of scenes that stand still, after 1, 2 and 4 jitter periods, and the time of a frame.

    Compared with the reference. Test shots are rendered here, with OpenGL. Times are measured well only if
    nothing else runs on the machine.

    \b
    Examples:
      supersampler bench still --scenes analytic:2 --methods taau
      supersampler bench still -o docs/images --json still.json --update README.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality.still import TIMED_RATIO, frame_count, measure_still, measure_times
    from supersampler_bench.quality.still_table import markdown_table, still_record, summary_table

    tables: Tables = {"still": markdown_table, "still summary": summary_table}
    if update is not None:
        find_blocks(update, list(tables))
    chosen, display, timed_display = (
        _scenes_of(scenes),
        parse_size(display_size, "--display-size"),
        TIMED_DISPLAY,
    )
    if quick:
        chosen = [(name, QUICK_RATIO) for name in dict(chosen)]
        display = timed_display = QUICK_DISPLAY
    names, kinds = listed(methods), executors_of(executors)
    ratios = [*(ratio for _, ratio in chosen), TIMED_RATIO]
    with counted("frames", sum(map(frame_count, ratios))) as advance:
        times = measure_times(names if "cpu" in kinds else [], timed_display, on_frame=advance)
        results = measure_still(chosen, names, display, executors=kinds, samples=samples, on_frame=advance)
    record = still_record(results, display, times, timed_display, quick=quick)
    if output is not None:
        from supersampler_bench.report.figures import draw_still  # needs matplotlib

        draw_still(record, output / "still.png")
        say(str(output / "still.png"))
    publish(record, tables, json, update)


def _scenes_of(text: str) -> list[tuple[str, float]]:
    """Return names and ratios of scenes.

    Raises:
        ArgumentError: there is no such scene, or a ratio is no number.
    """
    from supersampler_bench.quality.still import SCENES

    found = []
    for part in listed(text):
        name, _, ratio = part.partition(":")
        words_of("--scenes", name, SCENES)
        try:
            found.append((name, float(ratio)))
        except ValueError as error:
            raise ArgumentError("--scenes", got=repr(part), want="SCENE:RATIO, as analytic:2") from error
    return found
