"""Rendered training samples per hour: by scene family, in all, and the time of each part.

python bench/studies/render_speed.py --frames 4
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from supersampler.cli.arguments import parse_size
from supersampler.frame import Size
from supersampler_bench.cli.options import JSON, counted, publish
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.render_test_shots import driver_name
from supersampler_model.data.dataset import (
    Dataset,
    RenderPlan,
    create_dataset,
    plan_sequences,
    render_sequence,
)
from supersampler_model.data.dataset.workers import render_dataset
from supersampler_model.data.rendered import Reference, Surfaces
from supersampler_model.data.renderer.context import open_graphics
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.scene import Scene
from supersampler_model.data.sequences import TRAIN_FAMILIES

RATIO = 2.0
_PARTS = {
    "frame": "frame and shadow maps",
    "display": "G-buffers of display size",
    "reference": "reference",
    "else": "scene, labels and writing",
}


@dataclass(frozen=True, kw_only=True)
class RenderLoad:
    """What is rendered: samples of every family as `supersampler render --gbuffers` keeps them.

    Attributes:
        display_size: (width, height) of references and G-buffers; inputs have half of that.
        samples: a pixel of the reference.
        workers: processes.
        frames: of each sequence, at least 3; of each family there is one sequence a worker.
    """

    display_size: Size = (960, 540)
    samples: int = 64
    workers: int = 2
    frames: int = 6

    def plan(self) -> RenderPlan:
        """Return the set to render: one family after the other, every worker at the same."""
        return RenderPlan(
            families=[family for family in TRAIN_FAMILIES for _ in range(self.workers)],
            sequences=len(TRAIN_FAMILIES) * self.workers,
            frames=self.frames,
            display_size=self.display_size,
            ratios=(RATIO,),
            samples=self.samples,
            gbuffers=True,
        )


def measure_render(load: RenderLoad, on_frame: Callable[[], None] = lambda: None) -> dict[str, Any]:
    """Render to a temporary folder and return the record, ready for JSON.

    A family's seconds are the median time from one finished sample to the next of a sequence, so that the
    start of processes and the making of scenes are left out; `wall` has them in.

    Raises:
        DataError: a worker failed.
    """
    with tempfile.TemporaryDirectory() as folder:
        dataset = create_dataset(Path(folder), plan_sequences(load.plan()))
        begin = time.perf_counter()
        render_dataset(dataset, workers=load.workers, on_frame=on_frame)
        wall = time.perf_counter() - begin
        seconds = _seconds_by_family(dataset)
        total = load.frames * len(dataset.entries())
    mean = float(np.mean(list(seconds.values())))
    rates = {family: _rate(load.workers, each) for family, each in seconds.items()}
    parts, driver = _shares_of_parts(load)
    return {
        "bench": "render",
        "display_size": list(load.display_size),
        "ratio": RATIO,
        "samples": load.samples,
        "workers": load.workers,
        "frames": total,
        "driver": driver,
        "seconds_per_sample": {**seconds, "all": mean},
        "samples_per_hour": {**rates, "all": _rate(load.workers, mean)},
        "wall": {"seconds": wall, "samples_per_hour": total / wall * 3600.0},
        "share_of_time": parts,
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    (width, height), rates = record["display_size"], record["samples_per_hour"]
    parts = ", ".join(f"{part} {share:.0%}" for part, share in record["share_of_time"].items())
    rows = [
        "| family | seconds a sample | samples an hour |",
        "| --- | ---: | ---: |",
        *(f"| {name} | {s:.2f} | {rates[name]:.0f} |" for name, s in record["seconds_per_sample"].items()),
        f"| all, with start and tail | | {record['wall']['samples_per_hour']:.0f} |",
        "",
        f"References of {width}x{height} with {record['samples']} samples a pixel, {record['workers']} "
        f"workers. Of the time: {parts}. {machine_name(record)}.",
    ]
    return "\n".join(rows)


def _rate(workers: int, seconds: float) -> float:
    return workers * 3600.0 / seconds


def _seconds_by_family(dataset: Dataset) -> dict[str, float]:
    """Return the median seconds of a sample in one worker, from when its files were finished."""
    steps: dict[str, list[float]] = {}
    for entry in dataset.entries():
        done = [dataset.path(entry, index).stat().st_mtime_ns for index in range(entry.spec.frames)]
        steps.setdefault(entry.spec.family, []).extend(np.diff(done) / 1e9)
    return {family: float(np.median(values)) for family, values in steps.items()}


class _TimedRenderer(Renderer):
    """Adds up the seconds that each of its images takes; `spent` is by the name of the method."""

    spent: dict[str, float]

    def frame(self, scene: Scene, render_size: Size, *, jitter: tuple[float, float]) -> tuple[Any, Surfaces]:
        with self._timed("frame"):
            return super().frame(scene, render_size, jitter=jitter)

    def display(self, scene: Scene) -> Surfaces:
        with self._timed("display"):
            return super().display(scene)

    def reference(self, scene: Scene) -> Reference:
        with self._timed("reference"):
            return super().reference(scene)

    @contextmanager
    def _timed(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        yield
        self.spent[name] += time.perf_counter() - begin


def _shares_of_parts(load: RenderLoad) -> tuple[dict[str, float], str]:
    """Return each part's share of the time of one sample of each family, in one process; and the driver."""
    graphics = open_graphics()
    renderer = _TimedRenderer(load.display_size, samples=load.samples, graphics=graphics)
    spent = dict.fromkeys(_PARTS, 0.0)
    for family in TRAIN_FAMILIES:
        for name, seconds in _seconds_of_parts(family, renderer, load).items():
            spent[name] += seconds
    total = sum(spent.values())
    return {_PARTS[name]: seconds / total for name, seconds in spent.items()}, driver_name(graphics)


def _seconds_of_parts(family: str, renderer: _TimedRenderer, load: RenderLoad) -> dict[str, float]:
    """Return the parts of a sequence's second sample; the first has uploaded its textures."""
    begin = 0.0

    def first_done() -> None:
        nonlocal begin
        if not begin:
            renderer.spent = dict.fromkeys(_PARTS, 0.0)
            begin = time.perf_counter()

    renderer.spent = dict.fromkeys(_PARTS, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        plan = replace(load.plan(), families=[family], sequences=1, frames=2)
        dataset = create_dataset(Path(folder), plan_sequences(plan))
        [entry] = dataset.entries()
        render_sequence(dataset, entry, renderer, on_frame=first_done)
        rendering = sum(renderer.spent.values())
        return {**renderer.spent, "else": time.perf_counter() - begin - rendering}


def main(
    size: Annotated[
        str, typer.Option(metavar="WxH", help="Display size; inputs have half of it.")
    ] = "960x540",
    samples: Annotated[int, typer.Option(help="Of the reference, a pixel; a square number.")] = 64,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    frames: Annotated[int, typer.Option(min=3, help="Of each family and worker.")] = 6,
    json: JSON = None,
) -> None:
    """Time `supersampler render --gbuffers` into a temporary folder; keep the machine idle otherwise."""
    load = RenderLoad(
        display_size=parse_size(size, "--size"), samples=samples, workers=workers, frames=frames
    )
    with counted("rendering", load.plan().sequences * frames) as advance:
        record = measure_render(load, advance)
    publish(record, {"render": markdown_table}, json, None)


if __name__ == "__main__":
    typer.run(main)
