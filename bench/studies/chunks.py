"""Chunks: a long shot by two local workers with one core each, against one worker with one core.

Two workers are two `openjd run --tasks` processes of examples/farm/supersample.yaml. One worker is one
`supersampler upscale`, without chunks. Images of both are compared.

    python bench/studies/chunks.py --json FILE --update docs/how-to/farm.md

The shot is rendered where it is missing; a stopped rendering continues. Needs Linux and two cores.
"""

import json as json_text
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer

from supersampler import halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32
from supersampler.io.display import ExposureMeter, decibels, display_transform
from supersampler.io.image_reading import read_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler_bench.cli.options import JSON, METHODS, UPDATE, check_page, counted, listed, publish
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import SequenceSpec, make_sequence

TEMPLATE = Path(__file__).parents[2] / "examples" / "farm" / "supersample.yaml"
RENDER, DISPLAY = (480, 270), (960, 540)
RATIO = DISPLAY[0] / RENDER[0]
FAMILY = "court"  # of the test shots: its exposure is measured, so that chunks need that of earlier frames
WORKERS = 2


def render(folder: Path, family: str, frames: int) -> None:
    """Render the missing frames of the shot."""
    spec = SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=frames)
    sequence, renderer = make_sequence(spec), Renderer(DISPLAY)
    writer = ShotWriter(folder, name=family, display_size=DISPLAY, frame_rate=spec.frame_rate, resume=True)
    with counted("rendering", frames, len(writer), resumes=True) as advance:
        for index in range(len(writer), frames):
            jitter, cut = halton_jitter(index, RATIO), sequence.cut(index)
            frame = rendered_frame(renderer, sequence.scene(index), RENDER, jitter, reset=cut)
            writer.write(replace(frame, exposure=sequence.exposure(index), gbuffer=None))
            advance()


def upscale(shot: Path, output: Path, *options: str) -> list[str]:
    """Return the command of a run with one thread."""
    command = [sys.executable, "-m", "supersampler", "upscale", str(shot), "-o", str(output)]
    return [*command, "--threads", "1", *options]


def farm(output: Path, shot: Path, frames: int, preroll: int, method: str, *options: str) -> list[str]:
    """Return the `openjd run` command of the job, with a chunk for each worker."""
    values = {
        "Shot": shot, "Output": output, "Frames": f"0-{frames - 1}", "ChunkSize": chunk_size(frames),
        "Preroll": preroll, "Method": method, "Options": "--threads 1", "Python": sys.executable,
    }  # fmt: skip
    given = [text for name, value in values.items() for text in ("-p", f"{name}={value}")]
    return [sys.executable, "-m", "openjd", "run", str(TEMPLATE), *given, *options]


def seconds_of(*commands: Sequence[str]) -> float:
    """Run commands at once, each on a core of its own; return the wall time until the last has ended.

    Raises:
        CalledProcessError: one has failed.
    """
    own, processes = os.sched_getaffinity(0), []
    began = time.perf_counter()
    try:
        for core, command in zip(sorted(own), commands, strict=False):
            os.sched_setaffinity(0, {core})  # the process inherits it
            processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))  # noqa: S603
    finally:
        os.sched_setaffinity(0, own)
    codes = [process.wait() for process in processes]
    seconds = time.perf_counter() - began
    for code, command in zip(codes, commands, strict=True):
        if code:
            raise subprocess.CalledProcessError(code, command)
    return seconds


def chunk_size(frames: int) -> int:
    """Return the number of frames of a chunk, one for each worker."""
    return -(-frames // WORKERS)


def tasks_of(frames: int) -> list[str]:
    """Return the value of `--tasks` for each worker: one chunk."""
    size = chunk_size(frames)
    ranges = [f"{first}-{min(first + size, frames) - 1}" for first in range(0, frames, size)]
    return [json_text.dumps([{"Frames": text}]) for text in ranges]


def scores(shot: Shot, one: Path, many: Path) -> list[float]:
    """Return the PSNR of each frame of the chunks against the unbroken run, display values, dB."""
    meter, found = ExposureMeter(), []
    for index in range(len(shot)):
        raw = shot.read_raw(index, gbuffers=())
        assert raw.color is not None  # noqa: S101 - `render` shades every frame
        exposure = meter.read(raw.color, given=raw.exposure, reset=raw.reset)
        a, b = (display_transform(image(folder / f"{index:04d}.exr"), exposure) for folder in (one, many))
        found.append(decibels(float(np.square(a - b, dtype=np.float64).mean())))
    return found


def image(path: Path) -> Float32:
    """Read an image, (H, W, 3) linear RGB."""
    channels = read_exr(path)
    return np.stack([channels[name].astype(np.float32) for name in "RGB"], axis=-1)


def measured_row(
    folder: Path, frames: int, preroll: int, method: str, times: int, on_run: Callable[[], None]
) -> dict[str, Any]:
    """Run the shot both ways, in turns; return times and the PSNR of each frame, ready for JSON."""
    options, job = ("--method", method), (folder.resolve(), frames, preroll, method)
    seconds: dict[str, list[float]] = {"one": [], "exposures": [], "chunks": []}
    with TemporaryDirectory(dir=folder.parent) as place:
        seconds_of(upscale(folder, Path(place, "warm"), "--frames", "0-7", *options))  # compiles kernels
        for turn in range(times):
            one, chunks = Path(place, f"one{turn}"), Path(place, f"chunks{turn}")
            seconds["one"].append(seconds_of(upscale(folder, one, "--preroll", str(preroll), *options)))
            on_run()
            seconds["exposures"].append(seconds_of(farm(chunks, *job, "--step", "Exposures")))
            workers = [farm(chunks, *job, "--step", "Upscale", "--tasks", text) for text in tasks_of(frames)]
            seconds["chunks"].append(seconds_of(*workers))
            on_run()
        psnr = scores(Shot.open(folder), one, chunks)
    return {"method": method, "seconds": seconds, "psnr": psnr}


def markdown_table(record: Record) -> str:
    """Return times and PSNR as Markdown, with a caption."""
    size, cells = chunk_size(record["frames"]), []
    for row in record["rows"]:
        one, exposures, chunks = (median(row["seconds"][name]) for name in ("one", "exposures", "chunks"))
        later = row["psnr"][size:]
        numbers = [figure(value, 1) for value in (one, exposures, chunks)]
        psnr = [figure(value, 1) for value in (min(row["psnr"]), median(later))]
        cells.append([row["method"], *numbers, figure(chunks / one, 2), *psnr])
    caption = (
        f"{record['frames']} frames of the test scene {record['family']}, images of "
        f"{size_text(record['display'])}; {WORKERS} workers with a chunk each and a preroll of "
        f"{record['preroll']}, against one worker without chunks; a worker has one core, and one thread "
        f"for the method. Seconds: medians of "
        f"{record['times']}; exposures are measured once, before the chunks. PSNR against the run without "
        f"chunks, display values: the lowest of all frames, and the median after the first chunk, whose "
        f"frames are equal. {machine_name(record)}."
    )
    headings = [
        "method", "one, s:", "exposures, s:", "chunks, s:", "ratio:", "lowest PSNR, dB:", "median, dB:",
    ]  # fmt: skip
    return table(headings, cells, caption)


def main(
    shot: Annotated[Path, typer.Option(help="Folder of the shot.")] = Path("out/chunks/shot"),
    family: Annotated[str, typer.Option(help="Of the test shots.")] = FAMILY,
    frames: Annotated[int, typer.Option(min=64, help="Of the shot.")] = 640,
    preroll: Annotated[
        int, typer.Option(min=0, help="Frames before the first one of a chunk.")
    ] = jitter_phase_count(RATIO),
    methods: METHODS = "classifier,taau",
    times: Annotated[int, typer.Option(min=1, help="Runs of each kind, in turns.")] = 3,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure time and images of two workers against one."""
    tables = {"study chunks": markdown_table}
    check_page(update, tables)
    render(shot, family, frames)
    names = listed(methods)
    with counted("runs", 2 * times * len(names)) as advance:
        rows = [measured_row(shot, frames, preroll, name, times, advance) for name in names]
    record = {
        "bench": "chunks",
        "family": family,
        "frames": frames,
        "display": list(DISPLAY),
        "preroll": preroll,
        "times": times,
        "rows": rows,
    }
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
