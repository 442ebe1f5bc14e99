"""What the files of a run cost: EXR by compression, PNG and TIFF, and what is shown of linear light.

    python bench/studies/output_compression.py --json FILE --update docs/how-to/output-files.md

CPU time of all threads, as a median of several calls; files go to a temporary folder.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.io.display import to_uint8, to_uint16
from supersampler.io.display_transforms import DisplayTransform, display_transform_from
from supersampler.io.images import half_pixels, write_exr, write_png, write_tiff
from supersampler.io.shot import open_source
from supersampler_bench.cli.options import JSON, UPDATE, check_page, counted, publish, sizes_of
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.record import Record, machine_name

FILES, SHOWN = "study output compression", "study display transforms"
COMPRESSIONS = ("none", "zip", "piz", "dwaa")
AOVS = 8
SHOT, FRAME = "plaza", 31


def measure_files(image: Float32, times: int) -> Iterator[dict[str, Any]]:
    """Yield CPU time and file size of an image in each format; EXR without AOVs and with eight."""
    shown = DisplayTransform().show(image)
    passes = np.concatenate([image] * 3, axis=-1)[..., :AOVS] * np.linspace(0.3, 0.9, AOVS, dtype=np.float32)
    integers = (
        ("PNG, 8 bit", "png", to_uint8, write_png),
        ("PNG, 16 bit", "png", to_uint16, write_png),
        ("TIFF, 16 bit", "tif", to_uint16, write_tiff),
    )
    for arrays in ([image], [image, passes]):
        to_half = cpu_ms(partial(half_pixels, arrays), times)
        pixels = half_pixels(arrays)
        names = [*"RGB", *(f"aovs.{index}" for index in range(pixels.shape[2] - 3))]
        for compression in COMPRESSIONS:
            write = partial(write_exr, image=pixels, channels=names, compression=compression)
            cost = measure_file("exr", write, times)
            yield {"file": f"EXR, {compression}", "channels": len(names), "convert_ms": to_half, **cost}
    for name, extension, convert, save in integers:
        spent = cpu_ms(partial(convert, shown), times)
        cost = measure_file(extension, partial(save, image=convert(shown)), times)
        yield {"file": name, "channels": 3, "convert_ms": spent, **cost}


def measure_file(extension: str, write: Callable[..., None], times: int) -> dict[str, float]:
    """Return CPU time and size of one file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"image.{extension}"
        return {"write_ms": cpu_ms(partial(write, path), times), "bytes": path.stat().st_size}


def measure_transforms(image: Float32, times: int) -> Iterator[dict[str, Any]]:
    """Yield CPU time of each way to show an image."""
    for name, transform in (
        ("exposure, tone curve, sRGB", display_transform_from()),
        ("the same of ACEScg", display_transform_from(color_space="ACEScg")),
        ("sRGB alone", display_transform_from(srgb=True)),
        ("OpenColorIO, ACES 2.0 SDR", display_transform_from(ocio="ocio://studio-config-latest")),
        ("OpenColorIO, un-tone-mapped", display_transform_from(view="Un-tone-mapped")),
    ):
        yield {"transform": name, "show_ms": cpu_ms(partial(transform.show, image), times)}


def filled(image: Float32, size: Size) -> Float32:
    """Return an image mirrored until it fills (width, height), brighter to the right: no part repeats."""
    after = ((0, size[1] - image.shape[0]), (0, size[0] - image.shape[1]), (0, 0))
    gain = np.linspace(0.5, 2.0, size[0], dtype=np.float32)[:, None]
    return np.ascontiguousarray(np.pad(image, after, mode="symmetric") * gain)


def cpu_ms(work: Callable[[], object], times: int) -> float:
    """Return the median CPU time of some calls, in ms."""
    spent = []
    for _ in range(times):
        before = time.process_time()
        work()
        spent.append((time.process_time() - before) * 1e3)
    return float(np.median(spent))


def files_table(record: Record) -> str:
    """Return the table of files, with its caption."""
    rows = [
        (
            size_text(row["size"]),
            row["channels"],
            row["file"],
            figure(row["convert_ms"] + row["write_ms"], 0),
            figure(row["convert_ms"], 0),
            figure(row["bytes"] / 1e6, 1),
        )
        for row in record["files"]
    ]
    caption = (
        f"CPU ms of a frame, all threads; what of it converts float32 to the file's type; size. The image is "
        f"the reference of frame {FRAME} of {SHOT}, mirrored until it fills the size, and brighter to the "
        f"right, so that no part repeats; the other channels are the same image, darker. dwaa is lossy, at "
        f"its default of 45. {machine_name(record)}."
    )
    return table(["size", "channels:", "file", "CPU ms:", "converting:", "MB:"], rows, caption)


def transforms_table(record: Record) -> str:
    """Return the table of display transforms, with its caption."""
    rows = [(size_text(row["size"]), row["transform"], figure(row["show_ms"], 0)) for row in record["shown"]]
    caption = f"CPU ms of an image, all threads. {machine_name(record)}."
    return table(["size", "shown", "CPU ms:"], rows, caption)


def main(
    sizes: Annotated[str, typer.Option(help="With commas between.")] = "1920x1080,3840x2160",
    times: Annotated[int, typer.Option(min=1, help="Timed calls of each.")] = 5,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure the time of writing and showing a frame, and the size of files."""
    tables = {FILES: files_table, SHOWN: transforms_table}
    check_page(update, tables)
    image = next(open_source(SHOT).frames(FRAME)).reference
    if image is None:
        raise ArgumentError("shot", got=f"{SHOT} without a reference", want=f"one in frame {FRAME}")
    files, shown = [], []
    with counted("sizes", len(sizes_of("--sizes", sizes))) as advance:
        for size in sizes_of("--sizes", sizes):
            full = filled(image, size)
            files += [{"size": size, **row} for row in measure_files(full, times)]
            shown += [{"size": size, **row} for row in measure_transforms(full, times)]
            advance()
    record = {"bench": "output_compression", "times": times, "files": files, "shown": shown}
    publish(record, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
