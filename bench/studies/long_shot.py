"""What a whole run of `supersampler upscale` costs, where its time goes, and its memory over many frames.

    python bench/studies/long_shot.py FOLDER --json FILE --update docs/how-to/upscale-sequences.md

A few frames of a test scene are rendered into FOLDER once; a shot of any length is made of links to them.
Results are deleted while they are written.
"""

import json as jsonlib
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from supersampler import Frame, halton_jitter
from supersampler.frame import Size
from supersampler.io.files import remove_files, write_text
from supersampler.io.shot import ShotWriter
from supersampler.io.shot.format import load_shot_json, shot_json
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish, sizes_of
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import SequenceSpec, make_sequence

RUNS = "study whole runs"
FAMILY, RATIO = "market", 2.0
STAGES = ("read", "step", "write", "video")
EVERY = 0.5  # seconds between two samples of the memory


def main(
    folder: Annotated[Path, typer.Argument(help="For the rendered frames, and results while they exist.")],
    display_size: Annotated[str, typer.Option(help="Sizes of the results.")] = "1920x1080,3840x2160",
    frames: Annotated[int, typer.Option(help="Of each timed run.")] = 96,
    ring: Annotated[int, typer.Option(help="Rendered frames that a shot repeats.")] = 64,
    long: Annotated[
        int, typer.Option(help="Frames of the run whose memory is sampled; 0 leaves it out.")
    ] = 10000,
    options: Annotated[str, typer.Option(help="Of the long run.")] = "--method taau --compression none",
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure whole runs."""
    check_page(update, {RUNS: markdown_table})
    rows = []
    for size in sizes_of("--display-size", display_size):
        source = rendered(folder, size, ring)
        for formats in (["exr"], ["png"], ["exr", "png", "mp4"]):
            chosen = [f"--format={name}" for name in formats]
            run = upscaled(repeated(source, frames), folder / "out", ["--method", "classifier", *chosen])
            rows.append({"size": list(size), "formats": formats, **run})
            print(jsonlib.dumps(rows[-1]), flush=True)
    record: dict[str, Any] = {"bench": "long_shot", "frames": frames, "cores": os.cpu_count(), "rows": rows}
    if long:
        source = rendered(folder, sizes_of("--display-size", display_size)[0], ring)
        with TemporaryDirectory(dir=folder) as output:
            run = upscaled(repeated(source, long), Path(output), options.split())
        record["long"] = {"frames": long, "options": options, "size": rows[0]["size"], **run}
    publish(record, {RUNS: markdown_table}, json, update)


def rendered(folder: Path, display: Size, count: int) -> Path:
    """Render frames into a shot, unless they are there; return its folder."""
    path = folder / f"ring-{size_text(display)}"
    render = round(display[0] / RATIO), round(display[1] / RATIO)
    sequence = make_sequence(SequenceSpec(family=FAMILY, seed=0, frames=count))
    with ShotWriter(path, name=FAMILY, display_size=display, frame_rate=24, resume=path.exists()) as writer:
        renderer = None
        for index in range(len(writer), count):
            renderer = renderer or Renderer(display)
            jitter = halton_jitter(index, RATIO)
            color, surfaces = renderer.frame(sequence.scene(index), render, jitter=jitter)
            writer.write(
                Frame(
                    color=color, depth=surfaces.depth, motion=surfaces.motion, jitter=jitter, reset=index == 0
                )
            )
    return path


def repeated(source: Path, count: int) -> Path:
    """Return a shot.json beside that of a shot, of links to its frames: forwards, again from the first."""
    info, entries = load_shot_json(source / "shot.json")
    frames, links = [], source / "links"
    links.mkdir(exist_ok=True)
    for index in range(count):
        entry = entries[index % len(entries)]
        link = links / f"{index:06d}.exr"
        if not link.exists():
            os.link(source / entry.file, link)
        frames.append(replace(entry, file=f"links/{link.name}"))
    path = source / f"{count}.json"
    write_text(path, shot_json(info, frames))
    return path


def upscaled(shot: Path, output: Path, options: list[str]) -> dict[str, Any]:
    """Run `supersampler upscale`, and delete its files while it runs.

    Returns:
        Wall and CPU seconds of its frames (the start of the process is not included), and the memory in MiB
        at the frames at which it was sampled.
    """
    command = [sys.executable, "-m", "supersampler", "upscale", str(shot), "-o", str(output), "--json"]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True) as process:  # noqa: S603
        memory, last = [], 0.0
        for line in process.stdout or ():
            event = jsonlib.loads(line)
            if event["event"] == "frame":
                remove_files(output.rglob(f"{event['number']:04d}.*"))
            if event["event"] == "frame" and time.monotonic() - last >= EVERY:
                last = time.monotonic()
                memory.append([event["index"] + 1, resident(process.pid)])
    if process.returncode:
        sys.exit(f"upscale failed: {process.returncode}")
    return {
        "wall": event["seconds"],
        "cpu": event["cpu_seconds"],
        "stages": event["stages"],
        "memory": memory,
    }


def resident(process: int) -> float:
    """Return the resident memory of a process, MiB (Linux)."""
    status = Path(f"/proc/{process}/status").read_text(encoding="utf-8")
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    return round(int(found[1]) / 1024, 1) if found else 0.0


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    frames, cores = record["frames"], record["cores"]
    cells = []
    for row in record["rows"]:
        stages = [row["stages"].get(name, {"wall": 0.0})["wall"] / frames for name in STAGES]
        busy = row["cpu"] / cores / row["wall"]
        each = [figure(1000 * seconds, 0) for seconds in (row["wall"] / frames, row["cpu"] / frames, *stages)]
        cells.append([size_text(row["size"]), " + ".join(row["formats"]), *each, figure(1 / busy, 2)])
    header = [
        "results",
        "files",
        "wall ms:",
        "CPU ms:",
        *(f"{name}:" for name in STAGES),
        "wall / (CPU / cores):",
    ]
    caption = (
        f"One frame of `supersampler upscale` with `classifier`, of {frames} frames of half the size in EXR "
        f"(zip; colour half, depth and motion float): milliseconds of wall and CPU time of the run, and wall "
        f"time in each stage, which run side by side. {machine_name(record)}."
    )
    return table(header, cells, caption + memory_text(record))


def memory_text(record: Record) -> str:
    """Return what the memory did over the long run."""
    if "long" not in record:
        return ""
    long = record["long"]
    begin, middle, end = (
        max(mib for frame, mib in long["memory"] if a <= frame / long["frames"] <= b)
        for a, b in ((0.0, 0.1), (0.1, 0.55), (0.55, 1.0))
    )
    return (
        f" Over {long['frames']} frames of {size_text(long['size'])} (`{long['options']}`) the process had "
        f"at most {begin:.0f} MiB in the first tenth, {middle:.0f} MiB up to the middle, {end:.0f} MiB after."
    )


if __name__ == "__main__":
    typer.run(main)
