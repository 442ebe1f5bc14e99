"""Preroll: how near the first images of a chunk come to those of an unbroken run.

A chunk starts with a reset, N frames before its first one. The table compares its first images with those of
a run that starts with the shot, and gives the floor that no preroll passes: the PSNR between two runs whose
histories once differed by SMALLEST. At rest it also gives what `at_rest="off"` costs against the truth.

    python bench/studies/preroll.py --json FILE --update docs/how-to/farm.md

A stopped run continues after the rows that are finished (`--rows`).
"""

import json as json_text
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import numpy as np
import typer

from supersampler import Model, Upscaler, halton_jitter
from supersampler.arguments import AtRest
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Frame
from supersampler.io.display import CEILING_DB, ExposureMeter, decibels, display_transform
from supersampler.io.files import write_text
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish, say
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.quality.still import StillScene, make_scene
from supersampler_bench.record import Record, machine_name
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import SequenceSpec, make_sequence
from supersampler_model.data.shots import render_size

DISPLAY = (640, 360)
PREROLLS = (0, 8, 16, 32, 64)
CUTS = (80, 112)  # first frames of the chunks; the unbroken run has more history than any preroll
COMPARED = 4  # frames of a chunk
SMALLEST = 1e-6  # relative difference of a history's colour, after the frame before the longest preroll
SEQUENCE = 640  # frames of the sequence that a moving scene begins: cuts and exposure depend on it
METHODS = ("taa", "taau", "classifier-small", "classifier")
WITH_GBUFFERS = "gbuffer-small"  # in scenes of FEW at 2x: it has no kernels, and takes long
FEW = ("market", "court")
MOVING = tuple((family, 2.0) for family in TEST_SHOTS.seeds) + tuple(
    (family, ratio) for ratio in (1.5, 3.0) for family in FEW
)
_HEADINGS = [*(f"preroll {n}:" for n in PREROLLS), "one period:", "floor:"]
STILL = ("court", "court-mover", "gallery-mover")


@dataclass(frozen=True)
class Row:
    """One method in one scene.

    Attributes:
        scene: family of a test shot, or a scene of `bench still`.
        still: whether the camera stands still.
        ratio: display over render size.
        method: the model's name.
        at_rest: as `Upscaler` takes it.
        least: PSNR in dB of the worst compared image, for each of PREROLLS and for one jitter period.
        mean: of the compared images, likewise.
        floor: PSNR in dB of the worst compared image of two unbroken runs whose histories once differed by
            SMALLEST.
        truth: at rest: PSNR against the reference over the last quarter of the frames, of pixels that never
            change; else None.
    """

    scene: str
    still: bool
    ratio: float
    method: str
    at_rest: AtRest
    least: list[float]
    mean: list[float]
    floor: float
    truth: float | None

    @property
    def key(self) -> tuple[object, ...]:
        """What no two rows have in common."""
        return self.scene, self.still, self.ratio, self.method, self.at_rest


def moving_scene(family: str, ratio: float, *, gbuffers: bool) -> list[Frame]:
    """Render the first frames of a test shot with a moving camera.

    Args:
        family: of the test shot.
        ratio: display over render size.
        gbuffers: whether frames have those of display size.
    """
    renderer, size = Renderer(DISPLAY), render_size(DISPLAY, ratio)
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=SEQUENCE))
    frames = []
    for index in range(CUTS[-1] + COMPARED):
        scene, jitter = sequence.scene(index), halton_jitter(index, ratio)
        frame = rendered_frame(renderer, scene, size, jitter, reset=sequence.cut(index), gbuffers=gbuffers)
        frames.append(replace(frame, exposure=sequence.exposure(index)))
    return frames


def exposures_of(frames: Sequence[Frame]) -> list[float]:
    """Return the exposure of each frame in the unbroken run."""
    meter = ExposureMeter()
    return [meter.read(frame.color, given=frame.exposure, reset=frame.reset) for frame in frames]


def images_of(
    model: Model, at_rest: AtRest, frames: Sequence[Frame], exposures: Sequence[float]
) -> list[Float32]:
    """Return the images of a run over these frames, (H, W, 3) display values."""
    upscaler = Upscaler(model, display_size=DISPLAY, at_rest=at_rest, validate="off")
    return [
        display_transform(upscaler.step(frame), exposure)
        for frame, exposure in zip(frames, exposures, strict=True)
    ]


def chunk_scores(
    model: Model, at_rest: AtRest, frames: Sequence[Frame], whole: Sequence[Float32], preroll: int
) -> list[float]:
    """Return the PSNR of each compared image of the chunks with this preroll, dB.

    Args:
        model: of the run.
        at_rest: of the run.
        frames: of the scene.
        whole: images of the unbroken run.
        preroll: number of frames before a chunk's first one.
    """
    exposures, scores = exposures_of(frames), []
    for cut in CUTS:
        start, stop = cut - preroll, cut + COMPARED
        first = replace(frames[start], reset=True, exposure=exposures[start])
        images = images_of(model, at_rest, [first, *frames[start + 1 : stop]], exposures[start:stop])
        for image, other in zip(images[preroll:], whole[cut:stop], strict=True):
            scores.append(decibels(float(np.square(image - other, dtype=np.float64).mean())))
    return scores


def floor_of(model: Model, at_rest: AtRest, frames: Sequence[Frame], whole: Sequence[Float32]) -> float:
    """Return the PSNR of the worst compared image after a difference of SMALLEST in the history, dB.

    Args:
        model: of the run.
        at_rest: of the run.
        frames: of the scene.
        whole: images of the run without the difference.
    """
    exposures, start = exposures_of(frames), CUTS[0] - PREROLLS[-1]
    upscaler = Upscaler(model, display_size=DISPLAY, at_rest=at_rest, validate="off")
    scores = []
    for index, frame in enumerate(frames[: CUTS[-1] + COMPARED]):
        if index == start:
            state = upscaler.save_state()
            history = dict(state.history or {})
            name = next(name for name in history if name.endswith("color"))
            noise = np.random.default_rng(0).standard_normal(history[name].shape, np.float32)
            history[name] = np.maximum(history[name] * (1.0 + np.float32(SMALLEST) * noise), 0.0)
            upscaler.load_state(replace(state, history=history))
        image = display_transform(upscaler.step(frame), exposures[index])
        if any(cut <= index < cut + COMPARED for cut in CUTS):
            scores.append(decibels(float(np.square(image - whole[index], dtype=np.float64).mean())))
    return min(scores)


def measured_row(
    name: str, ratio: float, method: str, at_rest: AtRest, frames: Sequence[Frame], scene: StillScene | None
) -> Row:
    """Measure one method in one scene; `scene` is that of the frames if its camera stands still."""
    model = Model.load(method, providers="cpu")
    whole, truth = images_of(model, at_rest, frames, exposures_of(frames)), None
    if scene is not None:
        last = whole[-len(whole) // 4 :]
        truth = fmean(psnr(image, scene.truth, scene.still) for image in last)
    period = jitter_phase_count(ratio)
    by_preroll = {n: chunk_scores(model, at_rest, frames, whole, n) for n in {*PREROLLS, period}}
    scores = [by_preroll[n] for n in (*PREROLLS, period)]
    least, mean = [min(values) for values in scores], [fmean(values) for values in scores]
    floor = floor_of(model, at_rest, frames, whole)
    return Row(name, scene is not None, ratio, method, at_rest, least, mean, floor, truth)


def measured_rows(done: Sequence[Row]) -> Iterator[Row]:
    """Measure all rows but those that are done."""
    keys = {row.key for row in done}
    for name, ratio in MOVING:
        gbuffers = ratio == 2.0 and name in FEW
        methods = [*METHODS, *([WITH_GBUFFERS] if gbuffers else [])]
        missing = [m for m in methods if (name, False, ratio, m, "off") not in keys]
        frames = moving_scene(name, ratio, gbuffers=gbuffers) if missing else []
        for method in missing:
            yield measured_row(name, ratio, method, "off", frames, None)
    ways: tuple[AtRest, ...] = ("converge", "off")
    for name in STILL:
        pairs = [
            (m, at_rest) for m in METHODS for at_rest in ways if (name, True, 2.0, m, at_rest) not in keys
        ]
        scene = make_scene(name, DISPLAY, 2.0, TEST_SHOTS.samples) if pairs else None
        for method, at_rest in pairs:
            assert scene is not None  # noqa: S101 - rendered for these pairs
            yield measured_row(name, 2.0, method, at_rest, scene.frames, scene)


def markdown_table(record: Record) -> str:
    """Return a row for each method and ratio, of moving cameras, as Markdown with its caption."""
    rows = [row for row in rows_of(record) if not row.still]
    groups: dict[tuple[str, float], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.method, row.ratio), []).append(row)
    cells = [
        [method, f"{ratio:g}", *scores_of(group), min(group, key=lambda row: row.least[-1]).scene]
        for (method, ratio), group in groups.items()
    ]
    ratios = sorted({row.ratio for row in rows})
    periods = ", ".join(f"{jitter_phase_count(ratio)} at {ratio:g}" for ratio in ratios)
    scenes = ", ".join(dict.fromkeys(row.scene for row in rows))
    caption = (
        f"PSNR in dB of the first {COMPARED} images of a chunk against the unbroken run, display values, "
        f"after a preroll of so many frames, or of one jitter period "
        f"({periods}): of the worst image, and the mean; {CEILING_DB:g} is equal. Worst scene: "
        "that of the worst image after one period. "
        "Floor: of the worst image of two unbroken runs whose histories once differed by a factor of 1 + "
        f"{SMALLEST:g} times noise. Chunks at frames {CUTS[0]} and {CUTS[1]} of test shots with a moving "
        f"camera ({scenes}; for `{WITH_GBUFFERS}` and at ratios other than 2 {' and '.join(FEW)}), images of "
        f'{size_text(record["display"])}, `at_rest="off"`, CPU backend where the method has kernels. '
        f"{machine_name(record)}."
    )
    return table(["method", "ratio:", *_HEADINGS, "worst scene"], cells, caption)


def still_table(record: Record) -> str:
    """Return a row for each scene with a fixed camera, method and `at_rest`, as Markdown with its caption."""
    rows = [row for row in rows_of(record) if row.still]
    cells = [[row.scene, row.method, row.at_rest, *scores_of([row]), figure(row.truth, 1)] for row in rows]
    caption = (
        'The same before a fixed camera at ratio 2; objects move in scenes that end with "-mover". Truth: '
        "PSNR of the unbroken run against the reference in the last jitter period, of pixels that never "
        f"change. {machine_name(record)}."
    )
    return table(["scene", "method", "at rest", *_HEADINGS, "truth:"], cells, caption)


def rows_of(record: Record) -> list[Row]:
    """Return the rows of a record."""
    return [Row(**row) for row in record["rows"]]


def scores_of(rows: Sequence[Row]) -> list[str]:
    """Return the cells of _HEADINGS: PSNR of the worst image of all rows, and the mean; the lowest floor."""
    least = [min(values) for values in zip(*(row.least for row in rows), strict=True)]
    mean = [fmean(values) for values in zip(*(row.mean for row in rows), strict=True)]
    cells = [f"{a:.1f} ({b:.1f})" for a, b in zip(least, mean, strict=True)]
    return [*cells, figure(min(row.floor for row in rows), 1)]


def main(
    rows: Annotated[Path, typer.Option(help="Finished rows, by line; the run continues after them.")] = Path(
        "out/preroll.jsonl"
    ),
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure how near the first images of chunks come to those of an unbroken run."""
    tables = {"study preroll": markdown_table, "study preroll at rest": still_table}
    check_page(update, tables)
    rows.parent.mkdir(parents=True, exist_ok=True)
    lines = rows.read_text(encoding="utf-8").splitlines() if rows.exists() else []
    found = [Row(**json_text.loads(line)) for line in lines]
    for row in measured_rows(tuple(found)):
        found.append(row)
        say(f"{row.scene} {row.ratio:g} {row.method} {row.at_rest}: {row.least}")
        lines.append(json_text.dumps(asdict(row)))
        write_text(rows, "\n".join(lines) + "\n")
    record: dict[str, Any] = {
        "bench": "preroll",
        "display": list(DISPLAY),
        "prerolls": list(PREROLLS),
        "rows": [asdict(row) for row in sorted(found, key=_order)],
    }
    publish(record, tables, json, update)


def _order(row: Row) -> tuple[object, ...]:
    methods = (*METHODS, WITH_GBUFFERS)
    return row.still, row.ratio, methods.index(row.method), row.scene, row.at_rest


if __name__ == "__main__":
    typer.run(main)
