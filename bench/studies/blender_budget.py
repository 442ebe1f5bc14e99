"""Blender's Cycles at equal cost: full-size frames, with OIDN and without, against small ones, upscaled.

A budget is a number of samples of a full-size pixel; a small render gets `scale` squared times as many, so
that both trace as many rays. All are compared with a reference of many samples, by a box filter of one pixel,
after the display transform, without motion blur and depth of field.
    python bench/studies/blender_budget.py kitchen.blend --blender PATH --display-size 640x360 --json FILE
"""

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from supersampler.cli.arguments import parse_size
from supersampler.frame import Float32, Size
from supersampler.integrations.blender.process import find_blender
from supersampler.integrations.blender.render import RenderRequest, frame_range, rendering
from supersampler.io.display import auto_exposure, decibels, display_transform
from supersampler.io.images import read_exr, read_exr_metadata
from supersampler.io.shot import Shot
from supersampler.upscaler import Upscaler
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import setting, write_json

METHODS = ("bicubic", "classifier")
FULL_SIZE = """
import json, sys
import bpy
wanted = json.loads(sys.argv[-1])
bpy.ops.wm.open_mainfile(filepath=wanted["blend"])
scene = bpy.context.scene
render, cycles = scene.render, scene.cycles
render.engine = "CYCLES"
cycles.samples, cycles.use_denoising = wanted["samples"], wanted["denoise"]
cycles.use_adaptive_sampling = False
cycles.pixel_filter_type, cycles.filter_width, cycles.use_animated_seed = "BOX", 1.0, True
cycles.seed += wanted["seed"]
render.use_motion_blur = scene.camera.data.dof.use_dof = False
render.use_compositing = render.use_sequencer = False
render.resolution_x, render.resolution_y = wanted["size"]
render.resolution_percentage = 100
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
for number in wanted["frames"]:
    scene.frame_set(number)
    render.filepath = f"{wanted['folder']}/{number:04d}.exr"
    bpy.ops.render.render(write_still=True)
"""


def main(
    blend: Annotated[Path, typer.Argument(help="A scene for Cycles whose camera or objects move.")],
    blender: Annotated[str | None, typer.Option(help="Blender, or a Python that has bpy.")] = None,
    display_size: Annotated[str, typer.Option(help="Of the images.")] = "640x360",
    scale: Annotated[float, typer.Option(help="Display over render size.")] = 2.0,
    frames: Annotated[str, typer.Option(help="Frames of the sequence.")] = "1-24",
    compared: Annotated[int, typer.Option(help="Number of frames, the last ones, to compare.")] = 3,
    budgets: Annotated[str, typer.Option(help="Samples of a full-size pixel.")] = "1,4,16,64",
    reference_samples: Annotated[int, typer.Option(help="Of the references.")] = 1024,
    output: Annotated[Path | None, typer.Option("--json", help="File of the record.")] = None,
) -> None:
    """Measure one scene and print the table."""
    size, (first, last) = parse_size(display_size), frame_range(frames)
    numbers, program = list(range(last - compared + 1, last + 1)), find_blender(blender)
    with tempfile.TemporaryDirectory() as folder:
        truth, _ = full_size(program, blend, size, numbers, reference_samples, Path(folder), seed=1000)
        rows = []
        for budget in map(int, budgets.split(",")):
            small = round(budget * scale**2)
            for denoise in (False, True):
                images, seconds = full_size(
                    program, blend, size, numbers, budget, Path(folder), denoise=denoise
                )
                rows.append(row(f"full size, {budget}", denoise, psnr(images, truth), seconds, 0.0))
                request = RenderRequest(
                    blend=blend,
                    frames=(first, last),
                    display_size=size,
                    scale=scale,
                    samples=small,
                    denoise=denoise,
                    engine="cycles",
                    program=program,
                )
                place = Path(folder) / f"small{small}{denoise}"
                with rendering(request, place, note=lambda _: None) as render:
                    results = {method: upscaled(render.shot, size, method, numbers) for method in METHODS}
                    times = [render_seconds(render.shot, index) for index in range(len(render.shot))]
                for method, (images, step) in results.items():
                    rows.append(
                        row(f"{method}, {small}", denoise, psnr(images, truth), float(np.mean(times)), step)
                    )
    record = {
        "bench": "blender_budget",
        **setting(),
        "scene": blend.name,
        "display_size": size,
        "scale": scale,
        "frames": [first, last],
        "compared": numbers,
        "reference_samples": reference_samples,
        "rows": rows,
    }
    print(markdown(record))
    if output is not None:
        write_json(record, output)


def full_size(
    program: str,
    blend: Path,
    size: Size,
    numbers: list[int],
    samples: int,
    folder: Path,
    *,
    denoise: bool = False,
    seed: int = 0,
) -> tuple[dict[int, Float32], float]:
    """Render frames at display size; return them by number, and seconds a frame."""
    place, script = folder / f"full{samples}{denoise}{seed}", folder / "full_size.py"
    place.mkdir()
    script.write_text(FULL_SIZE, encoding="utf-8")
    wanted = {
        "blend": str(blend.resolve()),
        "size": size,
        "frames": numbers,
        "samples": samples,
        "denoise": denoise,
        "seed": seed,
        "folder": str(place),
    }
    python = Path(program).stem.startswith("python")
    options = [] if python else ["--background", "--python-exit-code", "1", "--python"]
    command = [program, *options, str(script), *([] if python else ["--"]), json.dumps(wanted)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    subprocess.run(command, check=True, capture_output=True, env=environment)  # noqa: S603  # the user names it
    paths = {number: place / f"{number:04d}.exr" for number in numbers}
    seconds = [seconds_of(read_exr_metadata(path)) for path in paths.values()]
    return {number: color(path) for number, path in paths.items()}, float(np.mean(seconds))


def upscaled(shot: Shot, size: Size, method: str, numbers: list[int]) -> tuple[dict[int, Float32], float]:
    """Return the upscaled frames by number, and seconds of a step."""
    images: dict[int, Float32] = {}
    with Upscaler(method, display_size=size, render_size=shot.render_size) as upscaler:
        upscaler.warm_up()
        for item in shot:
            image, number = upscaler.step(item.frame), shot.first_number + item.index
            if number in numbers:
                images[number] = image
        return images, upscaler.stats.seconds / upscaler.stats.frames


def render_seconds(shot: Shot, index: int) -> float:
    """Return the seconds that Blender says it rendered a frame."""
    return seconds_of(shot.read_metadata(index))


def seconds_of(metadata: Mapping[str, Any]) -> float:
    """Return Blender's RenderTime, such as "01:02.50", in seconds."""
    total = 0.0
    for part in str(metadata["RenderTime"]).split(":"):
        total = total * 60 + float(part)
    return total


def color(path: Path) -> Float32:
    """Read (h, w, 3) linear RGB."""
    channels = read_exr(path, only="RGB")
    return np.stack([channels[axis] for axis in "RGB"], axis=-1).astype(np.float32)


def psnr(images: Mapping[int, Float32], truth: Mapping[int, Float32]) -> float:
    """Return the mean PSNR (dB) after the display transform, with the references' exposure."""
    found = []
    for number, image in images.items():
        exposure = auto_exposure(truth[number])
        shown = [display_transform(each, exposure).astype(np.float64) for each in (image, truth[number])]
        found.append(decibels(float(np.square(shown[0] - shown[1]).mean())))
    return float(np.mean(found))


def row(name: str, denoise: bool, decibel: float, render: float, step: float) -> dict[str, Any]:
    """Return one row of the record."""
    return {"name": name, "denoise": denoise, "psnr": decibel, "render_seconds": render, "step_seconds": step}


def markdown(record: Mapping[str, Any]) -> str:
    """Return the table of a record."""
    headings = ["image, samples a pixel", "OIDN", "PSNR dB:", "render s:", "step s:"]
    cells = [
        [
            item["name"],
            "yes" if item["denoise"] else "no",
            figure(item["psnr"], 2),
            figure(item["render_seconds"], 2),
            figure(item["step_seconds"], 3) if item["step_seconds"] else "–",
        ]
        for item in record["rows"]
    ]
    first, last = record["frames"]
    caption = (
        f"{record['scene']}, frames {first} to {last}, the last {len(record['compared'])} compared, "
        f"{size_text(record['display_size'])} at scale {record['scale']:g}; "
        f"references of {record['reference_samples']} samples. Seconds a frame; render: Blender's own figure."
    )
    return table(headings, cells, caption)


if __name__ == "__main__":
    typer.run(main)
