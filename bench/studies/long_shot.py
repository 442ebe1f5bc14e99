"""What a whole run of `supersampler upscale` costs, where its time goes, and its memory over many frames.

    python bench/studies/long_shot.py FOLDER --json FILE --update docs/how-to/output-files.md

A few frames of a test scene are rendered into FOLDER once; a shot of any length is made of links to them.
Results are deleted while they are written.
"""

import json as jsonlib
import os
import re
import resource
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler import Frame, halton_jitter
from supersampler.conventions import RawFrame
from supersampler.frame import Size
from supersampler.io.shot import Shot, ShotWriter
from supersampler.io.shot.format import shot_json
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish, sizes_of
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import SequenceSpec, make_sequence

RUNS = "study whole runs"
FAMILY, RATIO = "market", 2.0
EVERY = 0.5  # seconds between two samples of the memory


def main(
    folder: Annotated[Path, typer.Argument(help="For the rendered frames, and results while they exist.")],
    display_sizes: Annotated[str, typer.Option(help="Sizes of the results.")] = "1920x1080,3840x2160",
    frames: Annotated[int, typer.Option(help="Of each timed run.")] = 96,
    ring: Annotated[int, typer.Option(help="Rendered frames that a shot repeats.")] = 64,
    long: Annotated[int, typer.Option(help="Frames of the run whose memory is sampled; 0 leaves it out.")] = 10000,
    options: Annotated[str, typer.Option(help="Of `upscale`, in the long run.")] = "--method taau",
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure whole runs."""
    check_page(update, {RUNS: markdown_table})
    rows = []
    for size in sizes_of(display_sizes):
        source = rendered(folder, size, ring)
        for formats in (["exr"], ["png"], ["exr", "png", "mp4"]):
            chosen = [f"--format={name}" for name in formats]
            run = upscaled(repeated(source, frames), folder / "out", ["--method", "classifier", *chosen])
            rows.append({"size": list(size), "formats": formats, **run})
            print(jsonlib.dumps(rows[-1]), flush=True)
    record: dict[str, Any] = {"bench": "long_shot", "frames": frames, "cores": os.cpu_count(), "rows": rows}
    if long:
        source = rendered(folder, sizes_of(display_sizes)[0], ring)
        run = upscaled(repeated(source, long), folder / "out", options.split())
        record["long"] = {"frames": long, "options": options, **run}
    publish(record, {RUNS: markdown_table}, json, update)


def rendered(folder: Path, display: Size, count: int) -> Path:
    """Render frames with G-buffers and eight AOVs into a shot, unless they are there; return its folder."""
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
                Frame(color=color, depth=surfaces.depth, motion=surfaces.motion, jitter=jitter, reset=index == 0)
            )
    return path
