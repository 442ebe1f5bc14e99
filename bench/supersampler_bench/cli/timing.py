"""`supersampler bench ...` cost, speed, startup, device and skip: how long methods take."""

from typing import Annotated, cast

import typer
from rich.progress import Progress

from supersampler.cli.arguments import parse_size, parse_skip
from supersampler.errors import ArgumentError
from supersampler.model import Precision
from supersampler_bench.cli.against import check_not_given, compare_speed
from supersampler_bench.cli.options import (
    ERRORS,
    JSON,
    UPDATE,
    check_page,
    listed,
    parse_executors,
    publish,
    warn,
)


def cost(
    methods: Annotated[
        str,
        typer.Option(help="Names of shipped models with a network or model folders, with commas between."),
    ] = "classifier,classifier-small",
    display_size: Annotated[str, typer.Option(help="Of the images.")] = "960x540",
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Count the multiply-adds and parameters of networks, in their graphs.

    Example:
      supersampler bench cost --methods classifier,my_classifier --update docs/results/methods.md
    """
    from supersampler_bench.timing.network_cost import cost_record, markdown_table, measure_cost

    tables = {"cost": markdown_table}
    check_page(update, tables)
    size = parse_size(display_size)
    record = cost_record([measure_cost(name, size) for name in listed(methods)], size)
    publish(record, tables, json, update)


def startup(
    methods: Annotated[
        str, typer.Option(help="Shipped models or model folders, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    size: Annotated[str, typer.Option(help="Of the frame, render pixels.")] = "480x270",
    cold: Annotated[int, typer.Option(min=1, help="Processes that start with an empty kernel cache.")] = 3,
    warm: Annotated[int, typer.Option(min=1, help="Processes that start with a full one.")] = 5,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time the first frame of a program: with an empty kernel cache, and with a full one.

    Example:
      supersampler bench startup --methods classifier --update docs/results/backends.md
    """
    from supersampler_bench.timing.startup import markdown_table, measure_startup, startup_record

    tables = {"startup": markdown_table}
    check_page(update, tables)
    names, render = listed(methods), parse_size(size)
    with Progress(console=ERRORS, transient=True) as progress:
        task = progress.add_task("programs", total=len(names) * (cold + warm))
        results = measure_startup(
            names, render, cold=cold, warm=warm, on_process=lambda: progress.advance(task)
        )
    publish(startup_record(results, render, 2.0), tables, json, update)


def speed(
    context: typer.Context,
    methods: Annotated[
        str, typer.Option(help="Shipped models or model folders, with commas between.")
    ] = "taa,taau,classifier-small,classifier",
    sizes: Annotated[
        str | None,
        typer.Option(
            help="Display sizes, with commas between.",
            show_default="960x540,1920x1080; with --against 960x540",
        ),
    ] = None,
    executors: Annotated[str, typer.Option(help="cpu, onnx, or both with a comma between.")] = "cpu,onnx",
    threads: Annotated[
        str | None,
        typer.Option(
            help="Of the processor, with commas between.", show_default="1,2; with --against all cores"
        ),
    ] = None,
    precisions: Annotated[str, typer.Option(help="auto, fp32, fp16, int8, with commas between.")] = "auto",
    skip: Annotated[str, typer.Option(help="exact, auto or numbers, with commas between.")] = "exact",
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    steps: Annotated[int, typer.Option(min=1, help="That count, of each setting.")] = 30,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="PYTHON",
            help="Compare with another version: interpreter of an environment that has it. "
            "Methods run as they do by default.",
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=10, help="With --against: of --steps steps each.")] = 10,
    starts: Annotated[
        int,
        typer.Option(min=0, help="With --against: programs timed to their first image; 0, or 6 and more."),
    ] = 10,
    fresh: Annotated[
        int, typer.Option(min=0, help="With --against: the same with no kernels kept; 0 or from 6.")
    ] = 0,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time a step of methods, on this machine, beside plain variance clipping in the same run.

    Quiet machines measure well: nothing else should run.

    \b
    Examples:
      supersampler bench speed --sizes 1920x1080 --executors cpu --json speed.json
      supersampler bench speed --against ../before/.venv/bin/python --json against.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    if against is not None:
        only = ("executors", "precisions", "skip")
        taken = {"rounds": rounds, "steps": steps, "starts": starts, "fresh": fresh}
        check_not_given(context, only, "with --against methods run as they do by default")
        compare_speed(against, listed(methods), sizes, threads, ratio, taken, json, update)
        return
    check_not_given(context, ("rounds", "starts", "fresh"), "they are of --against")
    from supersampler_bench.timing.speed import markdown_table, measure_limits, measure_speed, speed_record

    tables = {"speed": markdown_table}
    check_page(update, tables)
    names, kinds = listed(methods), parse_executors(executors)
    kinds_of_precision = listed(precisions)
    if not set(kinds_of_precision) <= {"auto", "fp32", "fp16", "int8"}:
        raise ArgumentError("--precisions", got=repr(precisions), want="auto, fp32, fp16, int8")
    counts = [int(text) for text in listed(threads or "1,2")]
    displays = [parse_size(text) for text in listed(sizes or "960x540,1920x1080")]
    with ERRORS.status("timing"):
        results = measure_speed(
            names,
            displays,
            kinds,
            counts,
            precisions=[cast("Precision", kind) for kind in kinds_of_precision],
            skips=[parse_skip(text) for text in listed(skip)],
            ratio=ratio,
            steps=steps,
            on_left_out=warn,
        )
        limits = measure_limits()
    publish(speed_record(results, limits, ratio), tables, json, update)


def device(
    methods: Annotated[
        str, typer.Option(help="Shipped models or model folders, with commas between.")
    ] = "taau,classifier-small,classifier",
    sizes: Annotated[str, typer.Option(help="Display sizes, with commas between.")] = "1920x1080,3840x2160",
    precisions: Annotated[str, typer.Option(help="fp32, fp16, with commas between.")] = "fp32,fp16",
    provider: Annotated[str, typer.Option(help="Of ONNX Runtime.")] = "auto",
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    steps: Annotated[int, typer.Option(min=1, help="That count, of each.")] = 100,
    capture: Annotated[
        bool, typer.Option("--capture", help="Also with the step captured, as a CUDA graph.")
    ] = False,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time the ONNX backend on a device: frames and images stay in its memory.

    Example:
      supersampler bench device --provider cuda --capture --json device.json
    """
    from supersampler.model import Model
    from supersampler_bench.timing.device import device_record, markdown_table, measure_copy, measure_device

    tables = {"device": markdown_table}
    check_page(update, tables)
    kinds = listed(precisions)
    if not set(kinds) <= {"fp32", "fp16"}:
        raise ArgumentError("--precisions", got=repr(precisions), want="fp32, fp16 or both")
    names, displays = listed(methods), [parse_size(text) for text in listed(sizes)]
    wanted = [cast("Precision", kind) for kind in kinds]
    with ERRORS.status("timing"):
        results = measure_device(
            names,
            displays,
            wanted,
            provider=provider,
            ratio=ratio,
            steps=steps,
            captures=(False, True) if capture else (False,),
            on_left_out=warn,
        )
        copied = measure_copy(Model.load("bilinear", providers=provider, executor="onnx").device)
    publish(device_record(results, copied, ratio), tables, json, update)


def skip(
    scenes: Annotated[
        str, typer.Option(help="Families of test shots, with commas between.")
    ] = "court,gallery,market",
    methods: Annotated[str, typer.Option(help="That have kernels, with commas between.")] = "taau,classifier",
    display_size: Annotated[str, typer.Option(help="Of the images.")] = "960x540",
    ratio: Annotated[float, typer.Option(min=1.0, help="Display over render size.")] = 2.0,
    samples: Annotated[int, typer.Option(min=1, help="A pixel of the references.")] = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure the time that static-tile reuse saves and its error, in test shots with a fixed camera.

    Frames are rendered here, with OpenGL.

    Quiet machines measure well: nothing else should run.

    Example:
      supersampler bench skip --scenes court --methods classifier --update docs/results/backends.md
    """
    from supersampler_bench.timing.skip import frame_count, markdown_table, measure_skipping, skip_record

    tables = {"skip": markdown_table}
    check_page(update, tables)
    families, names, size = listed(scenes), listed(methods), parse_size(display_size)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task("frames", total=2 * len(families) * frame_count(ratio))
        results = measure_skipping(
            families, names, size, ratio=ratio, samples=samples, on_frame=lambda: progress.advance(task)
        )
    publish(skip_record(results, size, ratio), tables, json, update)
