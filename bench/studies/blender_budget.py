"""Blender's Cycles at equal cost: full-size frames, with OIDN and without, against small ones, upscaled.

Reads what blender_renders.py has rendered. All are compared with references of many samples, by a box filter
of one pixel, after the display transform, without motion blur and depth of field.
    python bench/studies/blender_budget.py out/budget --blender PATH --figure docs/images/blender-budget.png
"""

import json
import subprocess
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from studies.blender_renders import (
    BUDGETS,
    COMPARED,
    DISPLAY,
    REFERENCE,
    REGIONS,
    SCALE,
    FrameSet,
    frame_sets,
)
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Frame
from supersampler.io.display import auto_exposure, decibels, display_transform
from supersampler.io.files import replacing
from supersampler.io.image_reading import read_exr
from supersampler.io.images import write_exr
from supersampler.io.shot import Shot
from supersampler.io.shot.blender_render import import_render
from supersampler.io.shot.render_record import read_render_record
from supersampler.upscaler import Upscaler
from supersampler_bench.cli.options import JSON, UPDATE, check_page, counted, publish
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, setting

BLOCK = "study blender budget"
WAYS = {
    "native": "full size",
    "native + OIDN": "full size, OIDN",
    "bicubic": "bicubic",
    "bicubic, OIDN": "bicubic, OIDN",
    "upscaled": "upscaled",
    "OIDN before": "upscaled, OIDN before",
    "OIDN after": "upscaled, OIDN after",
}
"""Headings by name of what is compared."""
DEFAULT, NATIVE = "OIDN before", ("native", "native + OIDN")
NEAR = 0.1
"""Costs that differ by less are equal."""
Images = dict[int, Float32]
"""(H, W, 3) linear RGB by the frame's number."""


def measure_budgets(work: Path, blender: str) -> list[dict[str, Any]]:
    """Return PSNR (dB) and cost (CPU seconds of a frame) of each way at each budget of each scene."""
    found = {each.name for each in frame_sets() if is_complete(work, each)}
    rows = []
    with counted("budgets", len(REGIONS) * len(BUDGETS)) as advance:
        for scene in REGIONS:
            truth = {
                number: colors(work / each.name, number)
                for each in frame_sets()
                if each.reference and each.scene == scene and each.name in found
                for number in [each.frames[0]]
            }
            for budget in BUDGETS:
                of_scene = [each for each in frame_sets() if each.scene == scene and not each.reference]
                here = [each for each in of_scene if samples_of(each) == budget]
                if truth and found.issuperset(each.name for each in here):
                    ways = measure_budget(work, here, list(truth), blender)
                    rows += [
                        {
                            "scene": scene,
                            "budget": budget,
                            "way": way,
                            "psnr": psnr(images, truth, scene),
                            "seconds": cost,
                        }
                        for way, (images, cost) in ways.items()
                    ]
                advance()
    return rows


def measure_budget(
    work: Path, here: list[FrameSet], numbers: list[int], blender: str
) -> dict[str, tuple[Images, float]]:
    """Return images and cost of each way, of the sets of one scene and one budget."""
    small = {each.exact_guides: work / each.name for each in here if each.small and each.denoise}
    plain = {each.small: cost(work / each.name) for each in here if not each.denoise}
    full = [each for each in here if each.denoise and not each.small and each.frames[0] in numbers]
    denoised = float(np.mean([cost(work / each.name) for each in full]))
    ways = {}
    for way, kind in (("native", "Noisy Image"), ("native + OIDN", "Combined")):
        images = {each.frames[0]: colors(work / each.name, each.frames[0], kind) for each in full}
        ways[way] = images, denoised if kind == "Combined" else plain[False]
    for way, method, is_exact in (
        ("bicubic", "bicubic", False),
        ("bicubic, OIDN", "bicubic", False),
        ("upscaled", "classifier", True),
        ("OIDN before", "classifier", True),
    ):
        shot, noisy = import_render(small[is_exact] / "frames"), "OIDN" not in way
        images, step = upscaled(shot, method, numbers, noisy=noisy)
        ways[way] = images, step + (plain[True] if noisy else cost(small[is_exact]))
    images, step, filtering = denoised_after(shot, numbers, blender)
    return {**ways, "OIDN after": (images, step + filtering + plain[True])}


def upscaled(shot: Shot, method: str, numbers: list[int], *, noisy: bool) -> tuple[Images, float]:
    """Return the upscaled frames that are compared, and CPU seconds of a step."""
    images = {}
    with Upscaler(method, display_size=DISPLAY, render_size=shot.render_size, threads=1) as upscaler:
        upscaler.warm_up()
        spent = 0.0
        for number, frame in frames(shot, noisy=noisy):
            before = time.process_time()
            image = upscaler.step(frame)
            spent += time.process_time() - before
            if number in numbers:
                images[number] = image
        return images, spent / len(shot)


def denoised_after(shot: Shot, numbers: list[int], blender: str) -> tuple[Images, float, float]:
    """Return noisy frames upscaled and then denoised, and CPU seconds of a step and of OIDN.

    OIDN gets albedo and normals that are upscaled by the same weights.
    """
    spent, names = 0.0, {"albedo": "RGB", "normal": ("X", "Y", "Z")}
    with (
        tempfile.TemporaryDirectory() as folder,
        Upscaler(display_size=DISPLAY, render_size=shot.render_size, threads=1) as upscaler,
    ):
        for number, frame in frames(shot, noisy=True):
            assert frame.gbuffer is not None  # noqa: S101  # it is rendered
            guides = np.concatenate([frame.gbuffer[name] for name in ("base_color", "normal")], axis=-1)
            guided, before = replace(frame, aovs=guides.astype(np.float32)), time.process_time()
            result = upscaler.step(guided, outputs=("aovs",))
            spent += time.process_time() - before
            if number in numbers and result.aovs is not None:
                write_exr(Path(folder) / f"{number}-image.exr", result.image, list("RGB"))
                for place, name in enumerate(names):
                    pixels = np.ascontiguousarray(result.aovs[..., 3 * place : 3 * place + 3])
                    write_exr(Path(folder) / f"{number}-{name}.exr", pixels, list("RGB"))
        pairs = [[f"{folder}/{number}-{{}}.exr", f"{folder}/{number}.exr"] for number in numbers]
        script = Path(__file__).resolve().with_name("blender_denoise.py")
        command = [blender, str(script), json.dumps(pairs)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603  # by the user
        seconds = [float(line.split()[1]) for line in done.stdout.splitlines() if line.startswith("seconds ")]
        images = {}
        for number in numbers:
            channels = read_exr(Path(folder) / f"{number}.exr", only="RGB")
            images[number] = np.stack([channels[axis] for axis in "RGB"], axis=-1).astype(np.float32)
    return images, spent / len(shot), min(seconds)


def frames(shot: Shot, *, noisy: bool) -> list[tuple[int, Frame]]:
    """Return the frames with their numbers: as they were denoised, or before that."""
    found = []
    for item in shot:
        number, frame = shot.first_number + item.index, replace(item.frame, aovs=None)
        if noisy:
            frame = replace(frame, color=colors(shot.source.parent, number, "Noisy Image"))
        found.append((number, frame))
    return found


def samples_of(frame_set: FrameSet) -> int:
    """Return the budget of a set: samples of a full-size pixel."""
    return int(frame_set.samples / SCALE**2) if frame_set.small else frame_set.samples


def is_complete(work: Path, frame_set: FrameSet) -> bool:
    """Return whether all frames of a set are there."""
    numbers = range(frame_set.frames[0], frame_set.frames[1] + 1)
    return all((work / frame_set.name / "frames" / f"{number:04d}.exr").exists() for number in numbers)


def cost(folder: Path) -> float:
    """Return CPU seconds of rendering a frame of a set."""
    lines = (folder / "costs.jsonl").read_text(encoding="utf-8").splitlines()
    return float(np.mean([json.loads(line)["seconds"] for line in lines]))


def colors(folder: Path, number: int, kind: str = "Combined") -> Float32:
    """Read (h, w, 3) linear RGB of a frame: "Combined", or "Noisy Image", what it was before OIDN."""
    names = [f"ViewLayer.{kind}.{axis}" for axis in "RGB"]
    channels = read_exr(folder / "frames" / f"{number:04d}.exr", only=names)
    return np.stack([channels[name] for name in names], axis=-1).astype(np.float32)


def psnr(images: Mapping[int, Float32], truth: Mapping[int, Float32], scene: str) -> float:
    """Return the mean PSNR (dB) of the scene's region after the display transform."""
    (width, height), (x0, x1, y0, y1) = DISPLAY, REGIONS[scene]
    rows = slice(round((1 - y1) * height) + 1, round((1 - y0) * height) - 1)
    region = rows, slice(round(x0 * width) + 1, round(x1 * width) - 1)
    found = []
    for number, reference in truth.items():
        exposure = auto_exposure(reference[region])
        both = images[number][region], reference[region]
        pair = [display_transform(each, exposure).astype(np.float64) for each in both]
        found.append(decibels(float(np.square(pair[0] - pair[1]).mean())))
    return float(np.mean(found))


def gain(record: Record, row: Mapping[str, Any], way: str) -> float:
    """Return by how many dB a row is above what `way` reaches in the scene for the same cost.

    Between two budgets it is taken as on the line over the cost's logarithm; NaN more than `NEAR` below the
    cheapest or above the dearest.
    """
    points = sorted(
        (other["seconds"], other["psnr"])
        for other in record["rows"]
        if other["scene"] == row["scene"] and other["way"] == way
    )
    costs, values = zip(*points, strict=True)
    if not costs[0] * (1 - NEAR) <= row["seconds"] <= costs[-1] * (1 + NEAR):
        return float("nan")
    return float(row["psnr"] - np.interp(np.log(row["seconds"]), np.log(costs), values))


def markdown_table(record: Record) -> str:
    """Return the table: PSNR and cost of each way at each budget of each scene."""
    found = {(row["scene"], row["budget"], row["way"]): row for row in record["rows"]}
    lines = []
    for scene, budget in dict.fromkeys(key[:2] for key in found):
        cells = [found[scene, budget, way] for way in WAYS]
        best = max(row["psnr"] for row in cells)
        texts = [f"{figure(row['psnr'], 1)} / {figure(row['seconds'], 1)}" for row in cells]
        marked = [f"**{t}**" if row["psnr"] == best else t for t, row in zip(texts, cells, strict=True)]
        bicubic = max(found[scene, budget, way]["psnr"] for way in ("bicubic", "bicubic, OIDN"))
        ours = found[scene, budget, DEFAULT]
        gains = [ours["psnr"] - bicubic, *(gain(record, ours, way) for way in NATIVE)]
        lines.append([scene, budget, *marked, *("–" if np.isnan(g) else f"{g:+.1f}" for g in gains)])
    headings = [
        "scene",
        "budget:",
        *(f"{heading}:" for heading in WAYS.values()),
        "over bicubic:",
        "over full size:",
        "over full size, OIDN:",
    ]
    size, scale, last = size_text(record["display_size"]), record["scale"], record["frames"][1]
    numbers = " and ".join(map(str, record["compared"]))
    caption = (
        f"PSNR in dB / CPU seconds of a frame (user and system, all threads), rendering and upscaling; "
        f"Cycles of Blender {record['blender']}, {size}. A budget is a number of samples of a full-size "
        f"pixel; small frames (scale {scale:g}) have {scale**2:g} times as many. Against references of "
        f"{record['reference_samples']} samples in a part of frames {numbers} of {last}; PSNR is the mean. "
        f"OIDN before upscaling gets albedo and normals as they are; for full-size and bicubic images Cycles "
        f"filters them first, which is better there. "
        f"The last three columns: upscaled frames with OIDN before, the command's default, above the best "
        f"bicubic ones of their budget, and above full-size ones of the same cost (between budgets: "
        f"interpolated; – where no budget is as cheap)."
    )
    return table(headings, lines, caption)


def write_figure(record: Record, path: Path) -> None:
    """Write error over cost as a PNG file, one panel a scene."""
    scenes = list(dict.fromkeys(row["scene"] for row in record["rows"]))
    sheet = Figure(figsize=(4.2 * len(scenes), 4.0), layout="constrained")
    for axes, scene in zip(np.atleast_1d(sheet.subplots(1, len(scenes))), scenes, strict=True):
        for index, (way, heading) in enumerate(WAYS.items()):
            points = sorted(
                (row["seconds"], row["psnr"])
                for row in record["rows"]
                if row["scene"] == scene and row["way"] == way
            )
            style = "--" if way in NATIVE else ":" if way.startswith("bicubic") else "-"
            look = {"marker": "o", "markersize": 3, "color": f"C{index}", "label": heading}
            axes.plot(*zip(*points, strict=True), style, **look)
        axes.set(title=scene, xscale="log", xlabel="CPU seconds of a frame", ylabel="PSNR, dB")
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3, which="both")
    sheet.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=len(WAYS), fontsize=8)
    with replacing(path) as partial:
        sheet.savefig(partial, format="png", dpi=110)


def main(
    work: Annotated[Path, typer.Argument(help="Folder of blender_renders.py.")],
    blender: Annotated[str, typer.Option(help="A Python that has bpy.")],
    figure_file: Annotated[Path | None, typer.Option("--figure", help="PNG file of the curves.")] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure error and cost of what is rendered, and write table and figure."""
    tables = {BLOCK: markdown_table}
    check_page(update, tables)
    first = work / next(each.name for each in frame_sets() if each.small) / "frames"
    scene = read_render_record(first).scene
    if scene is None:
        raise ArgumentError("work", got=f"{first} without frames", want="a folder of blender_renders.py")
    record = {
        "bench": "blender_budget",
        **setting(),
        "blender": scene.blender,
        "display_size": DISPLAY,
        "scale": SCALE,
        "frames": [1, 24],
        "compared": sorted(COMPARED),
        "reference_samples": REFERENCE,
        "rows": measure_budgets(work, blender),
    }
    publish(record, tables, json, update)
    if figure_file is not None:
        write_figure(record, figure_file)


if __name__ == "__main__":
    typer.run(main)
