"""Chunks: a long shot by two local workers with one thread each, against one worker with one thread.

Two workers are two `openjd run --tasks` processes of examples/farm/supersample.yaml. One worker is one
`supersampler upscale`, without chunks. Images of both are compared.

    python bench/studies/chunks.py --shot out/chunks/shot --json FILE --update docs/how-to/farm.md

The shot is rendered where it is missing; a stopped rendering continues.
"""

import json as json_text
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
from supersampler.frame import Float32
from supersampler.io.display import ExposureMeter, decibels, display_transform
from supersampler.io.image_reading import read_exr
from supersampler.io.shot import Shot, ShotWriter
from supersampler_bench.cli.options import JSON, UPDATE, check_page, counted, publish
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


def render(folder: Path, frames: int) -> None:
    """Render the missing frames of the shot."""
    spec = SequenceSpec(family=FAMILY, seed=TEST_SHOTS.seeds[FAMILY], frames=frames)
    sequence, renderer = make_sequence(spec), Renderer(DISPLAY)
    writer = ShotWriter(folder, name=FAMILY, display_size=DISPLAY, frame_rate=spec.frame_rate, resume=True)
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


def farm(shot: Path, output: Path, frames: int, preroll: int, method: str, *options: str) -> list[str]:
    """Return the `openjd run` command of the job, with a chunk for each worker."""
    values = {
        "Shot": shot, "Output": output, "Frames": f"0-{frames - 1}", "ChunkSize": -(-frames // WORKERS),
        "Preroll": preroll, "Method": method, "Options": "--threads 1", "Python": sys.executable,
    }  # fmt: skip
    given = [text for name, value in values.items() for text in ("--job-param", f"{name}={value}")]
    openjd = str(Path(sys.executable).with_name("openjd"))
    return [openjd, "run", str(TEMPLATE), *given, *options]


def seconds_of(*commands: Sequence[str]) -> float:
    """Run commands at the same time; return the wall time until the last has ended.

    Raises:
        CalledProcessError: one has failed.
    """
    began = time.perf_counter()
    processes = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for command in commands]  # noqa: S603
    codes = [process.wait() for process in processes]
    seconds = time.perf_counter() - began
    for code, command in zip(codes, commands, strict=True):
        if code:
            raise subprocess.CalledProcessError(code, command)
    return seconds


def tasks_of(frames: int) -> list[str]:
    """Return the value of `--tasks` for each worker: one chunk."""
    size = -(-frames // WORKERS)
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


def measure(
    folder: Path, frames: int, preroll: int, method: str, times: int, on_run: Callable[[], None]
) -> dict[str, Any]:
    """Run the shot both ways, in turns; return the record."""
    shot, options = Shot.open(folder), ("--method", method)
    seconds: dict[str, list[float]] = {"one": [], "exposures": [], "chunks": []}
    with TemporaryDirectory(dir=folder.parent) as place:
        seconds_of(upscale(folder, Path(place, "warm"), "--frames", "0-7", *options))  # compiles kernels
        for turn in range(times):
            one, many = Path(place, f"one{turn}"), Path(place, f"chunks{turn}")
            seconds["one"].append(seconds_of(upscale(folder, one, "--preroll", str(preroll), *options)))
            on_run()
            job = farm(folder.resolve(), many, frames, preroll, method)
            seconds["exposures"].append(seconds_of([*job, "--step", "Exposures"]))
            workers = [[*job, "--step", "Upscale", "--tasks", tasks] for tasks in tasks_of(frames)]
            seconds["chunks"].append(seconds_of(*workers))
            on_run()
        psnr = scores(shot, one, many)
    return {
        "bench": "chunks",
        "family": FAMILY,
        "frames": frames,
        "display": list(DISPLAY),
        "method": method,
        "preroll": preroll,
        "workers": WORKERS,
        "seconds": seconds,
        "psnr": psnr,
    }


def markdown_table(record: Record) -> str:
    """Return the times and the lowest PSNR as Markdown, with a caption."""
    spent = {name: median(values) for name, values in record["seconds"].items()}
    size, psnr = -(-record["frames"] // record["workers"]), record["psnr"]
    later = psnr[size:]
    cells = [
        ["one worker, no chunks", figure(spent["one"], 1), figure(1.0, 2), "", ""],
        [
            f"{record['workers']} workers, a chunk each",
            figure(spent["chunks"], 1),
            figure(spent["chunks"] / spent["one"], 2),
            figure(min(psnr), 1),
            f"{sum(value >= 100.0 for value in later)} of {len(later)}",
        ],
        [
            "the exposures, once",
            figure(spent["exposures"], 1),
            figure(spent["exposures"] / spent["one"], 2),
            "",
            "",
        ],
    ]
    caption = (
        f"{record['frames']} frames of the test scene {record['family']}, images of "
        f"{size_text(record['display'])}, `{record['method']}`, a preroll of {record['preroll']}, one thread "
        f"a worker; median of {len(record['seconds']['one'])}. PSNR: the lowest of all frames against the "
        "run without chunks, "
        f"display values. Equal: frames of the later chunks that are the same bit for bit. "
        f"{machine_name(record)}."
    )
    return table(["run", "seconds:", "ratio:", "lowest PSNR dB:", "equal:"], cells, caption)


def main(
    shot: Annotated[Path, typer.Option(help="Folder of the shot.")] = Path("out/chunks/shot"),
    frames: Annotated[int, typer.Option(min=64, help="Of the shot.")] = 640,
    preroll: Annotated[int, typer.Option(min=0, help="Frames before the first one of a chunk.")] = 32,
    method: Annotated[str, typer.Option(help="A shipped model.")] = "classifier",
    times: Annotated[int, typer.Option(min=1, help="Runs of each kind, in turns.")] = 3,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure time and images of two workers against one."""
    tables = {"study chunks": markdown_table}
    check_page(update, tables)
    render(shot, frames)
    with counted("runs", 2 * times) as advance:
        record = measure(shot, frames, preroll, method, times, advance)
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
