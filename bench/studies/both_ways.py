"""Two passes against one: their time and memory, and backward motion.

    python bench/studies/both_ways.py times --json FILE --update docs/how-to/upscale-both-ways.md

times: the frames of the shipped shot, again and again, without cuts; runs of one pass and of two take turns,
and the ratio of their times is that of each pair. Memory is how far the largest resident size of the process
grows between 128 and 384 frames. motion: of the test shots' scenes, scattered from the next frame's against
what the renderer writes when it draws each frame towards the next.
"""

import os
import resource
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, Any

import numpy as np
import typer

from supersampler import halton_jitter
from supersampler.arguments import checked_choice
from supersampler.frame import Float32, Size
from supersampler.sequence.backward_motion import scattered_motion
from supersampler_bench.cli.options import JSON, UPDATE, check_page, listed, publish, sizes_of
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.two_passes import measure_passes
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.following import towards
from supersampler_model.data.sequences import make_sequence
from supersampler_model.data.specs import SequenceSpec


def main(
    what: Annotated[str, typer.Argument(help="times or motion.")],
    methods: Annotated[str, typer.Option(help="With commas between.")] = "classifier,taau",
    display_size: Annotated[str, typer.Option(help="Sizes of the timed images.")] = "960x540",
    frames: Annotated[int, typer.Option(help="Of each timed run.")] = 192,
    pairs: Annotated[int, typer.Option(help="Timed runs of one pass and of two.")] = 5,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure two passes."""
    name = f"study both ways, {checked_choice('what', what, TABLES)}"
    check_page(update, {name: TABLES[what]})
    names = listed(methods)
    if what == "times":
        sizes = sizes_of("--display-size", display_size)
        rows = [timing(method, size, frames, pairs) for size in sizes for method in names]
    else:
        rows = [motion_errors(family) for family in TEST_SHOTS.seeds]
    record = {"bench": f"both_ways {what}", "cores": os.cpu_count(), "frames": frames, "rows": rows}
    publish(record, {name: TABLES[what]}, json, update)


def timing(method: str, display: Size, count: int, pairs: int) -> dict[str, Any]:
    """Return seconds of runs with one pass and with two, and the growth of memory with the length."""
    spec = parse_spec(method)
    measure_passes(spec, display, frames=128, pairs=0)
    small = _peak()
    measure_passes(spec, display, frames=384, pairs=0)
    grown = _peak() - small
    times = measure_passes(spec, display, frames=count, pairs=pairs)
    return {"method": method, "size": list(display), "one": times.one, "two": times.two, "grown": grown}


def motion_errors(family: str, pairs: Sequence[int] = (5, 13, 21, 30)) -> dict[str, Any]:
    """Return errors of motion to the next frame, render pixels, over some frames of a test shot."""
    renderer = Renderer(TEST_SHOTS.display_size, samples=4)
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=40))
    size = TEST_SHOTS.display_size[0] // 2, TEST_SHOTS.display_size[1] // 2
    found: dict[str, list[Float32]] = {"scattered": [], "own": []}
    for index in (i for i in pairs if not sequence.cut(i + 1)):
        scenes = sequence.scene(index), sequence.scene(index + 1)
        jitters = halton_jitter(index, 2.0), halton_jitter(index + 1, 2.0)
        now, after = (rendered_frame(renderer, s, size, j) for s, j in zip(scenes, jitters, strict=True))
        surfaces = renderer.frame(towards(*scenes), size, jitter=jitters[0])[1]
        truth = surfaces.motion.astype(np.float32)
        for name, motion in (("scattered", scattered_motion(now, after)), ("own", -now.motion)):
            found[name].append(np.hypot(*np.moveaxis(motion - truth, -1, 0)).astype(np.float32))
    return {
        "shot": family,
        **{
            name: {"median": float(np.median(errors)), "over_half": float(np.mean(np.array(errors) > 0.5))}
            for name, errors in found.items()
        },
    }


def times_table(record: Record) -> str:
    """Return the times as a Markdown table."""
    rows = []
    for row in record["rows"]:
        ratio = statistics.median(two / one for one, two in zip(row["one"], row["two"], strict=True))
        each = [1e3 * statistics.median(row[name]) / record["frames"] for name in ("one", "two")]
        rows.append([
            row["method"], size_text(row["size"]), *(figure(value, 1) for value in each), figure(ratio, 2),
            figure(row["grown"] / 1e6, 0),
        ])  # fmt: skip
    head = ["method", "images", "one pass, ms:", "two passes, ms:", "ratio:", "MB more for 256 more frames:"]
    caption = f"Medians for each frame of {record['frames']}, reading and writing left out."
    return table(head, rows, f"{caption} {machine_name(record)}.")


def motion_table(record: Record) -> str:
    """Return the errors of motion as a Markdown table."""
    rows = [
        [
            row["shot"],
            *(figure(row[name]["median"], 4) for name in ("scattered", "own")),
            *(figure(100.0 * row[name]["over_half"], 2) for name in ("scattered", "own")),
        ]
        for row in record["rows"]
    ]
    head = ["shot", "scattered, median:", "own motion negated:", "scattered, % over 0.5:", "own, % over 0.5:"]
    return table(head, rows, "Errors of motion to the next frame, render pixels at 320x180, of all pixels.")


TABLES: Mapping[str, Callable[[Record], str]] = {"times": times_table, "motion": motion_table}


def _peak() -> int:
    """Return the largest resident size so far, bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


if __name__ == "__main__":
    typer.run(main)
