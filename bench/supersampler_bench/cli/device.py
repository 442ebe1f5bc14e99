"""`supersampler bench device`: how long steps take on a GPU."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.model import Model, Precision
from supersampler_bench.cli.options import (
    DISPLAY_SIZES,
    ERRORS,
    JSON,
    METHODS,
    STEPS,
    UPDATE,
    Tables,
    check_page,
    listed,
    numbers_of,
    publish,
    say,
    sizes_of,
    warn,
    words_of,
)
from supersampler_bench.record import setting, write_json


def device(
    methods: METHODS = "taa,taau,classifier-small,classifier,classifier-large",
    display_size: DISPLAY_SIZES = "3840x2160,1920x1080",
    precisions: Annotated[str, typer.Option(help="fp32, fp16, with commas between.")] = "fp32,fp16",
    providers: Annotated[str, typer.Option(help="Of ONNX Runtime, in order, commas between.")] = "auto",
    executor: Annotated[
        str, typer.Option(help="onnx; gpu: the shaders, by timestamp queries; torch: the modules on CUDA.")
    ] = "onnx",
    ratio: Annotated[str, typer.Option(help="Display over render size, with commas between.")] = "2",
    steps: STEPS = 100,
    capture: Annotated[
        bool, typer.Option("--capture", help="Also with the step captured, as a CUDA graph; torch: compiled.")
    ] = False,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time a backend on a device: frames and images stay in its memory.

    GPU: also each pass, copies of the device, steps on arrays, and the images against those of the CPU
    backend. The record is written after each result.

    \b
    Examples:
      supersampler bench device --providers cuda --capture --json device.json
      supersampler bench device --executor gpu --ratio 2,1.5,4 --steps 300 --json device-gpu.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import device as bench

    if executor not in (known := ("onnx", "gpu", "torch")):
        raise ArgumentError("--executor", got=repr(executor), want=f"one of {', '.join(known)}")
    kinds: tuple[Precision, ...] = ("fp32", "fp16")
    chosen = words_of("--precisions", precisions, kinds)
    names, displays, ratios = (
        listed(methods),
        sizes_of("--display-size", display_size),
        numbers_of("--ratio", ratio),
    )
    if executor == "gpu":
        _time_shaders(names, displays, ratios, steps, json, update)
        return
    tables = {"device": bench.markdown_table}
    check_page(update, tables)
    both = (False, True) if capture else (False,)
    taken: dict[str, Any] = {"ratios": ratios, "steps": steps, "on_left_out": warn}
    with ERRORS.status("timing"):
        if executor == "torch":
            from supersampler_bench.timing.device_torch import measure_torch

            results, name = measure_torch(names, displays, compiled=both, **taken), "cuda"
        else:
            results = bench.measure_device(
                names, displays, chosen, provider=providers, captures=both, **taken
            )
            name = Model.load("bilinear", providers=providers, executor="onnx").device
        copied = bench.measure_copy(name)
    publish(bench.device_record(results, copied), tables, json, update)


def _time_shaders(
    methods: list[str],
    displays: list[Size],
    ratios: list[float],
    steps: int,
    json: Path | None,
    update: Path | None,
) -> None:
    from supersampler_bench.timing import device_record as bench
    from supersampler_bench.timing.device_gpu import GpuStep, measure_gpu
    from supersampler_bench.timing.device_images import GpuImages, compare_images
    from supersampler_bench.timing.device_limits import measure_limits
    from supersampler_bench.timing.device_stopwatch import device_with_timestamps

    tables: Tables = {
        "device": bench.step_table,
        "device passes": bench.pass_table,
        "device images": bench.image_table,
    }
    check_page(update, tables)
    device, began = device_with_timestamps(), time.perf_counter()
    subject, limits = bench.gpu_subject(device, methods), measure_limits(device)
    say(f"{subject.adapter['device']}: copies {1e-9 * limits.moved:.0f} GB/s")
    timed: list[GpuStep] = []
    images: list[GpuImages] = []

    def keep(text: str) -> None:
        if json is not None:
            write_json({**bench.gpu_record(subject, limits, timed, images), **setting()}, json)
        say(f"{time.perf_counter() - began:6.1f} s: {text}")

    for step in measure_gpu(device, methods, displays, ratios, steps=steps, on_left_out=warn):
        timed.append(step)
        keep(f"{step.method} {step.render} to {step.display}: {step.median:.3f} ms, first {step.first:.1f} s")
    for image in compare_images(device, methods, on_left_out=warn):
        images.append(image)
        keep(f"{image.method}, {image.memory}: mean {image.mean:.1e}, largest {image.largest:.3f}")
    publish(bench.gpu_record(subject, limits, timed, images), tables, json, update)
