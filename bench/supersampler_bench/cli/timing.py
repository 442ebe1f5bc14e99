"""`supersampler bench` commands about time: cost, traffic, startup, latency, device, skip and pareto."""

import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Size
from supersampler.model import Model, Precision
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    DISPLAY_SIZES,
    ERRORS,
    EXECUTORS,
    JSON,
    METHODS,
    ONE_RATIO,
    SAMPLES,
    SCENES,
    STEPS,
    UPDATE,
    check_page,
    counted,
    executors_of,
    listed,
    numbers_of,
    publish,
    say,
    size_pairs_of,
    sizes_of,
    warn,
    words_of,
)
from supersampler_bench.record import SHIPPED_PARETO, BenchRecord, Provenance, read_record, write_json

ROUNDS = "With --against: of --steps steps each."
STARTS = "With --against: programs timed to their first image; 0, or 6 and more."
FRESH = "With --against: the same with an empty kernel cache; 0, or 6 and more."


def cost(
    methods: METHODS = "classifier,classifier-small",
    display_size: DISPLAY_SIZE = "960x540",
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Count the multiply-adds and parameters of networks, in their graphs.

    \b
    Example:
      supersampler bench cost --methods classifier,my_classifier --update docs/results/methods.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import traffic as bench

    check_page(update, bench.CostRecord, "cost")
    size = parse_size(display_size, "--display-size")
    costs = [bench.measure_cost(name, size) for name in listed(methods)]
    publish(bench.CostRecord(size, costs), "cost", json, update)


def traffic(
    methods: METHODS = "bilinear,taa,taau,classifier-small,classifier-small:fp16,classifier,classifier:fp16,"
    "gbuffer-fast,gbuffer-fast:fp16,gbuffer-small,gbuffer-small:fp16",
    sizes: Annotated[
        str, typer.Option(help="Render and display sizes, as 960x540:1920x1080, with commas between.")
    ] = "960x540:3840x2160,1920x1080:3840x2160",
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Count the bytes, multiply-adds and dispatches of a step of methods on the ONNX and the GPU backend.

    ONNX: from the runtime's profile of small runs, exact at the sizes named. GPU: from the accesses that
    shaders declare, with frame and image in textures. The second table has the times that named GPUs need at
    least, computed from their published figures.

    \b
    Example:
      supersampler bench traffic --methods classifier,classifier:fp16 --json traffic.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.specs import parse_spec
    from supersampler_bench.timing import traffic as bench
    from supersampler_bench.timing.gpu_traffic import count_gpu

    check_page(update, bench.TrafficRecord, "traffic")
    names, pairs = listed(methods), size_pairs_of(sizes)
    both = (bench.count_onnx, count_gpu)
    counters = {name: both if parse_spec(name).precision == "auto" else (bench.count_onnx,) for name in names}
    with counted("steps", sum(map(len, counters.values())) * len(pairs)) as advance:
        results = []
        for render, display in pairs:
            rows = []
            for name in names:
                for count in counters[name]:
                    try:
                        rows.append(count(name, render, display))
                    except (ArgumentError, DeviceError) as error:  # another ratio, no shaders, or no device
                        warn(f"{name}: {error}")
                    advance()
            results.append(bench.SizeTraffic(render, display, rows))
    publish(bench.TrafficRecord(results), "traffic", json, update)


def startup(
    methods: METHODS = "taa,taau,classifier-small,classifier",
    render_size: Annotated[str, typer.Option(metavar="WxH", help="Size of the frame.")] = "480x270",
    cold: Annotated[int, typer.Option(min=1, help="Processes that start with an empty kernel cache.")] = 3,
    warm: Annotated[int, typer.Option(min=1, help="Processes that start with a full one.")] = 5,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time the first frame of a program: with an empty kernel cache, and with a full one.

    \b
    Example:
      supersampler bench startup --methods classifier --update docs/results/backends.md
      supersampler bench startup --methods taau:gpu,classifier:gpu
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import against as bench

    check_page(update, bench.StartupRecord, "startup")
    names, render = listed(methods), parse_size(render_size, "--render-size")
    with counted("programs", len(names) * (cold + warm)) as advance:
        results = bench.measure_startup(names, render, cold=cold, warm=warm, on_process=advance)
    publish(bench.StartupRecord(render, 2.0, results), "startup", json, update)


def latency(
    context: typer.Context,
    methods: METHODS = "taa,taau,classifier-small,classifier",
    display_size: Annotated[
        str | None,
        typer.Option(
            help="Display sizes, with commas between.", show_default="1920x1080; with --against 960x540"
        ),
    ] = None,
    executors: EXECUTORS = "cpu",
    providers: Annotated[str, typer.Option(help="Of ONNX Runtime: auto, cpu, cuda, directml, ...")] = "cpu",
    threads: Annotated[
        str | None, typer.Option(help="CPU threads, with commas between.", show_default="all cores")
    ] = None,
    precisions: Annotated[str, typer.Option(help="auto, fp32, fp16, int8, with commas between.")] = "auto",
    ratio: ONE_RATIO = 2.0,
    warm_up: Annotated[int, typer.Option(min=1, help="Steps of each setting that do not count.")] = 20,
    steps: Annotated[
        int | None,
        typer.Option(min=1, help="Timed steps of each setting.", show_default="200; with --against 30"),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            metavar="PYTHON",
            help="Compare with another version: interpreter of an environment that has it. "
            "Methods run as they do by default.",
        ),
    ] = None,
    rounds: Annotated[int, typer.Option(min=10, help=ROUNDS)] = 10,
    starts: Annotated[int, typer.Option(min=0, help=STARTS)] = 10,
    fresh: Annotated[int, typer.Option(min=0, help=FRESH)] = 0,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time the steps of methods on this machine: median, p95, p99, stages, CPU time, memory, first image.

    A step is timed from a frame in memory to its image in memory. Settings of one size take turns, beside
    plain variance clipping (taa). Nothing else should run on the machine.

    \b
    Examples:
      supersampler bench latency
      supersampler bench latency --methods classifier --executors cpu,onnx,gpu --json latency.json
      supersampler bench latency --against ../before/.venv/bin/python --json against.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    counts = [int(text) for text in listed(threads or str(os.cpu_count() or 1))]
    if against is not None:
        only = ("executors", "providers", "precisions", "warm_up")
        _check_not_given(context, only, "with --against methods run as they do by default")
        taken = {"rounds": rounds, "steps": steps or 30, "starts": starts, "fresh": fresh}
        displays = sizes_of("--display-size", display_size or "960x540")
        _compare_versions(against, listed(methods), displays, counts, ratio, taken, json, update)
        return
    _check_not_given(context, ("rounds", "starts", "fresh"), "they are of --against")
    from supersampler_bench.timing import latency as bench

    check_page(update, bench.LatencyRecord, "latency")
    known: tuple[Precision, ...] = ("auto", "fp32", "fp16", "int8")
    with ERRORS.status("timing"):
        results = bench.measure_latency(
            listed(methods),
            sizes_of("--display-size", display_size or "1920x1080"),
            executors_of(executors),
            counts,
            precisions=words_of("--precisions", precisions, known),
            providers=providers,
            ratio=ratio,
            steps=steps or 200,
            warm_up=warm_up,
            on_left_out=warn,
        )
        limits = bench.measure_limits()
    publish(bench.LatencyRecord(ratio, results, limits), "latency", json, update)


def _check_not_given(context: typer.Context, names: Iterable[str], why: str) -> None:
    """Refuse parameters of the command that would have no effect."""
    for name in names:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            raise ArgumentError(f"--{name.replace('_', '-')}", got="given", want=f"left out: {why}")


def _compare_versions(
    python: str,
    methods: list[str],
    displays: list[Size],
    threads: list[int],
    ratio: float,
    taken: Mapping[str, int],
    json: Path | None,
    update: Path | None,
) -> None:
    from supersampler_bench.timing import against as bench

    check_page(update, bench.AgainstRecord, "against")
    rounds = bench.Rounds(**taken)
    with counted("rounds", len(methods) * rounds.total(len(displays) * len(threads))) as advance:
        sides, results = bench.measure_against(
            python, methods, displays, threads, ratio=ratio, rounds=rounds, on_round=advance, on_left_out=warn
        )
    publish(bench.AgainstRecord(ratio, sides, rounds, results), "against", json, update)


def skip(
    scenes: SCENES = "court,gallery,market",
    methods: METHODS = "taau,classifier",
    display_size: DISPLAY_SIZE = "960x540",
    ratio: ONE_RATIO = 2.0,
    samples: SAMPLES = 64,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Measure the time saved where nothing moves, what looking for it costs, and the error.

    In test shots with a fixed camera, static and with moving objects, and with a moving camera, where there
    is nothing to save. Methods need kernels. Frames are rendered here, with OpenGL. Nothing else should run
    on the machine.

    \b
    Example:
      supersampler bench skip --scenes court --methods classifier --update docs/results/backends.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import skip as bench

    check_page(update, bench.SkipRecord, "skip")
    families, names, size = listed(scenes), listed(methods), parse_size(display_size, "--display-size")
    with counted("frames", len(bench.MOVES) * len(families) * bench.frame_count(ratio)) as advance:
        results = bench.measure_skipping(
            families, names, size, ratio=ratio, samples=samples, on_frame=advance
        )
    record = bench.SkipRecord(size, ratio, results, bench.frame_count(ratio))
    publish(record, "skip", json, update)


def pareto(
    quality: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Records of `bench quality test-shots --json`, of any ratios, of `bench extrapolation "
            "test-shots --json`, or of --json here.",
            show_default="the scores of the shipped methods",
        ),
    ] = None,
    display_size: DISPLAY_SIZE = "960x540",
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 2,
    steps: STEPS = 20,
    budget_ms: Annotated[
        float | None, typer.Option(min=0.0, help="Name the best setting whose step takes no longer.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for a figure of each metric.")
    ] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time every setting that was scored, and plot time against error.

    Nothing else should run on the machine.

    \b
    Examples:
      supersampler bench pareto --budget-ms 16 --display-size 1920x1080
      supersampler bench pareto bench/results/quality-test-shots*.json -o docs/images --update docs/pareto.md
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality.extrapolation import ExtrapolationRecord
    from supersampler_bench.quality.score_table import QualityRecord
    from supersampler_bench.specs import gbuffers_of
    from supersampler_bench.timing import pareto as bench

    check_page(update, bench.ParetoRecord, "pareto")
    records = [BenchRecord.from_json(read_record(path)) for path in quality or [SHIPPED_PARETO]]
    size = parse_size(display_size, "--display-size")
    scored = [r for r in records if isinstance(r, QualityRecord | bench.ParetoRecord)]
    unscored = [r for r in records if isinstance(r, ExtrapolationRecord | bench.ParetoRecord)]
    with counted("rounds", (2 * len(bench.scores_of(scored)) + 1) * steps) as advance:
        points = bench.measure_pareto(
            scored, size, threads=threads, steps=steps, on_left_out=warn, on_round=advance
        )
        unshaded = bench.measure_unshaded(unscored, size, threads=threads, steps=steps, on_round=advance)
    record = bench.ParetoRecord(bench.shots_of(scored[0]), size, threads, points, unshaded)
    publish(record, "pareto", json, update)
    if output is not None:
        from supersampler_bench.report.figures import draw_pareto  # needs matplotlib

        draw_pareto(record, output)
    if budget_ms is not None:
        best = bench.best_within(points, budget_ms)
        for point in best:
            reads = " (reads G-buffers)" if gbuffers_of([point.run.model]) else ""
            say(f"ratio {point.ratio:g}: {point.spec}{reads}, {point.milliseconds:.1f} ms")
        if not best:
            say(f"no setting takes {budget_ms:g} ms or less")
            raise typer.Exit(1)


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
    check_page(update, bench.DeviceRecord, "device")
    both = (False, True) if capture else (False,)
    taken: dict[str, Any] = {"ratios": ratios, "steps": steps, "on_left_out": warn}
    with ERRORS.status("timing"):
        if executor == "torch":
            results, name = bench.measure_torch(names, displays, compiled=both, **taken), "cuda"
        else:
            results = bench.measure_device(
                names, displays, chosen, provider=providers, captures=both, **taken
            )
            name = Model.load("bilinear", providers=providers, executor="onnx").device
        copied = bench.measure_copy(name)
    publish(bench.DeviceRecord(results, copied), "device", json, update)


def _time_shaders(
    methods: list[str],
    displays: list[Size],
    ratios: list[float],
    steps: int,
    json: Path | None,
    update: Path | None,
) -> None:
    from supersampler_bench.timing.device_gpu import device_with_timestamps, measure_gpu
    from supersampler_bench.timing.device_record import GpuRecord, compare_images

    check_page(update, GpuRecord, "device")
    device, began = device_with_timestamps(), time.perf_counter()
    record = GpuRecord.of(device, methods)
    say(f"{record.adapter['device']}: copies {1e-9 * record.limits.moved:.0f} GB/s")

    def keep(text: str) -> None:
        if json is not None:
            write_json(replace(record, provenance=Provenance.now()), json)
        say(f"{time.perf_counter() - began:6.1f} s: {text}")

    for step in measure_gpu(device, methods, displays, ratios, steps=steps, on_left_out=warn):
        record.steps.append(step)
        keep(f"{step.method} {step.render} to {step.display}: {step.median:.3f} ms, first {step.first:.1f} s")
    for image in compare_images(device, methods, on_left_out=warn):
        record.images.append(image)
        keep(f"{image.method}, {image.memory}: mean {image.mean:.1e}, largest {image.largest:.3f}")
    publish(replace(record, provenance=Provenance.now()), "device", json, update)
