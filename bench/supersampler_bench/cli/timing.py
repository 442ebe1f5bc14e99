"""`supersampler bench` commands about time and cost, from `cost` and `traffic` to `device` and `pareto`."""

import os
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size
from supersampler_bench.cli import options
from supersampler_bench.record import SHIPPED_PARETO, BenchRecord, Provenance, read_record, write_json
from supersampler_bench.shots.public_shots import TEST_SHOTS


def cost(methods: options.METHODS = "classifier,classifier-small", json: options.JSON = None) -> None:
    """Count the multiply-adds and parameters of networks.

    \b
    Example:
      supersampler bench cost --methods classifier,my_classifier
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import traffic as bench

    options.publish(
        bench.CostRecord([bench.cost_of(name) for name in options.split_list(methods)]), "cost", json
    )


def traffic(
    methods: options.METHODS = "taa,taau,classifier-small,classifier,classifier-large,gbuffer-fast",
    display_size: options.DISPLAY_SIZE = "3840x2160",
    ratio: options.RATIOS = "2,4",
    json: options.JSON = None,
) -> None:
    """Count the bytes, multiply-adds and passes of a step on a GPU. No GPU is needed.

    \b
    Example:
      supersampler bench traffic --methods classifier --ratio 1.5,2
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import traffic as bench

    size, ratios = parse_size(display_size, "--display-size"), options.ratio_list(ratio)
    steps = bench.traffic_of(options.split_list(methods), size, ratios, on_left_out=options.warn)
    options.publish(bench.TrafficRecord(steps), "traffic", json)


def startup(
    methods: options.METHODS = "taa,taau,classifier-small,classifier",
    render_size: Annotated[str, typer.Option(metavar="WxH", help="Size of the frame.")] = "480x270",
    cold: Annotated[int, typer.Option(min=1, help="Processes that start with an empty cache.")] = 3,
    warm: Annotated[int, typer.Option(min=1, help="Processes that start with a warm one.")] = 5,
    json: options.JSON = None,
) -> None:
    """Time the first image of a program, with an empty and with a warm cache of GPU shaders.

    \b
    Example:
      supersampler bench startup --methods classifier
      supersampler bench startup --methods taau:gpu,classifier:gpu
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import startup as bench

    names, render = options.split_list(methods), parse_size(render_size, "--render-size")
    with options.counted("programs", len(names) * (cold + warm)) as advance:
        results = bench.measure_startup(names, render, cold=cold, warm=warm, on_process=advance)
    options.publish(bench.StartupRecord(render, bench.RATIO, results), "startup", json)


def latency(
    methods: options.METHODS = "taa,taau,classifier-small,classifier",
    display_size: options.DISPLAY_SIZES = "1920x1080",
    executors: options.EXECUTORS = "cpu",
    providers: Annotated[str, typer.Option(help="ONNX Runtime providers: auto, cpu, cuda, ...")] = "cpu",
    threads: options.THREADS = None,
    ratio: options.ONE_RATIO = 2.0,
    warm_up: Annotated[int, typer.Option(min=1, help="Warm-up steps of each setting.")] = 20,
    steps: options.STEPS = 200,
    json: options.JSON = None,
) -> None:
    """Time the steps of methods on this machine: median, p95, p99, stages, CPU time, memory, first image.

    A step is timed from a frame in memory to its image in memory. Settings of one size alternate, with taa on
    the CPU backend among them. Nothing else should run on the machine.

    \b
    Examples:
      supersampler bench latency
      supersampler bench latency --methods classifier --executors cpu,onnx,gpu --json latency.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import latency as bench

    with options.ERRORS.status("timing"):
        results = bench.measure_latency(
            options.split_list(methods),
            options.size_list("--display-size", display_size),
            options.executors_of(executors),
            options.count_list("--threads", threads or str(os.cpu_count() or 1)),
            providers=providers,
            ratio=ratio,
            steps=steps,
            warm_up=warm_up,
            on_left_out=options.warn,
        )
    options.publish(bench.LatencyRecord(ratio, results), "latency", json)


def skip(
    scenes: Annotated[str, typer.Option(help="Families of test shots, comma-separated.")] = (
        "court,gallery,market"
    ),
    methods: options.METHODS = "taau,classifier",
    display_size: options.DISPLAY_SIZE = "960x540",
    ratio: options.ONE_RATIO = 2.0,
    samples: options.SAMPLES = 64,
    json: options.JSON = None,
) -> None:
    """Measure the time saved where nothing moves, the cost of detecting it, and the error.

    The scenes are test shots with a fixed camera, with and without moving objects, and with a moving camera.
    Methods run on the CPU backend. Frames are rendered here, with OpenGL. Nothing else should run on the
    machine.

    \b
    Example:
      supersampler bench skip --scenes court --methods classifier
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import skip as bench

    families, names = options.words_of("--scenes", scenes, [*TEST_SHOTS.seeds]), options.split_list(methods)
    size = parse_size(display_size, "--display-size")
    with options.counted("frames", len(bench.MOVES) * len(families) * bench.frame_count(ratio)) as advance:
        results = bench.measure_skipping(
            families, names, size, ratio=ratio, samples=samples, on_frame=advance
        )
    options.publish(bench.SkipRecord(size, ratio, results, bench.frame_count(ratio)), "skip", json)


def views(
    methods: options.METHODS = "taau,classifier",
    display_size: options.DISPLAY_SIZES = "128x128,256x256",
    count: Annotated[int, typer.Option(min=1, help="Number of cameras.")] = 16,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; all cores unless given.")] = None,
    ratio: options.ONE_RATIO = 2.0,
    rounds: Annotated[int, typer.Option(min=1, help="Timed rounds of each setting.")] = 200,
    json: options.JSON = None,
) -> None:
    """Time the steps of several small cameras: in one call of `Upscaler.step_many`, and in one call for each.

    Nothing else should run on the machine.

    \b
    Example:
      supersampler bench views --count 64 --display-size 64x64
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing import views as bench

    names, sizes = options.split_list(methods), options.size_list("--display-size", display_size)
    threads = threads or os.cpu_count() or 1
    with options.counted("rounds", len(names) * len(sizes) * rounds) as advance:
        results = bench.measure_views(
            names, sizes, views=count, threads=threads, ratio=ratio, rounds=rounds, on_round=advance
        )
    options.publish(bench.ViewsRecord(count, threads, ratio, rounds, results), "views", json)


def pareto(
    quality: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Records of `bench quality test-shots --json`, of any ratios, or earlier records of --json.",
            show_default="the scores of the shipped methods",
        ),
    ] = None,
    display_size: options.DISPLAY_SIZE = "960x540",
    threads: Annotated[int, typer.Option(min=1, help="CPU threads.")] = 2,
    steps: options.STEPS = 20,
    budget_ms: Annotated[
        float | None, typer.Option(min=0.0, help="Also print the best setting within this time per step.")
    ] = None,
    output: options.FIGURES = None,
    json: options.JSON = None,
) -> None:
    """Time all scored settings, and plot time against error, in a figure for each metric.

    Nothing else should run on the machine.

    \b
    Examples:
      supersampler bench pareto --budget-ms 16 --display-size 1920x1080
      supersampler bench pareto bench/results/quality-test-shots*.json -o docs/images
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.specs import gbuffers_of
    from supersampler_bench.timing import pareto as bench

    records = [BenchRecord.from_json(read_record(path)) for path in quality or [SHIPPED_PARETO]]
    size = parse_size(display_size, "--display-size")
    with options.counted("rounds", 2 * len(bench.scores_of(records)) * steps) as advance:
        points = bench.measure_pareto(
            records, size, threads=threads, steps=steps, on_left_out=options.warn, on_round=advance
        )
    record = bench.ParetoRecord(bench.shot_names(records[0]), size, threads, points)
    options.publish(record, "pareto", json)
    if output is not None:
        from supersampler_bench.report import figures

        figures.draw_pareto(record, output)
    if budget_ms is not None:
        best = bench.best_within(points, budget_ms)
        for point in best:
            reads = " (reads G-buffers)" if gbuffers_of([point.run.model]) else ""
            options.say(f"ratio {point.ratio:g}: {point.spec}{reads}, {point.milliseconds:.1f} ms")
        if not best:
            options.say(f"no setting takes {budget_ms:g} ms or less")
            raise typer.Exit(1)


def device(
    methods: options.METHODS = "taa,taau,classifier-small,classifier,classifier-large",
    display_size: options.DISPLAY_SIZES = "3840x2160,1920x1080",
    ratio: options.RATIOS = "2,1.5,4",
    steps: options.STEPS = 300,
    minutes: Annotated[float, typer.Option(help="Begin no further measurement after this time.")] = 5.0,
    json: options.JSON = None,
) -> None:
    """Measure the GPU backend: throughput of the device, images, steps and passes, other runtimes.

    Steps are timed by timestamps of the device, with frame and image in textures. Their floor is the time of
    their bytes or multiply-adds at the device's measured throughput. Images are compared with the CPU
    backend's. At the first size, torch on CUDA and ONNX Runtime's GPU providers are timed if they are
    installed. The record is written after each result.

    \b
    Example:
      supersampler bench device --json device.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.timing.gpu_record import GpuRecord
    from supersampler_bench.timing.gpu_steps import compare_images, measure_gpu
    from supersampler_bench.timing.gpu_stopwatch import device_with_timestamps
    from supersampler_bench.timing.other_runtimes import measure_other_runtimes

    names, displays = options.split_list(methods), options.size_list("--display-size", display_size)
    ratios = options.ratio_list(ratio)
    device, began = device_with_timestamps(), time.perf_counter()
    record = GpuRecord.of(device)
    options.say(f"{record.adapter['device']}: copies {1e-9 * record.limits.moved:.0f} GB/s")

    def keep(text: str) -> bool:
        """Write the record; return whether there is time for more."""
        if json is not None:
            write_json(replace(record, provenance=Provenance.now()), json)
        options.say(f"{time.perf_counter() - began:6.1f} s: {text}")
        return time.perf_counter() - began < 60.0 * minutes

    for one in compare_images(device, names, on_left_out=options.warn):
        record.images.append(one)
        keep(f"{one.method}: {one.mean:.1e} from the CPU backend, at most {one.largest:.1e}")
    for step in measure_gpu(device, names, displays, ratios, steps=steps, on_left_out=options.warn):
        record.steps.append(step)
        size = f"{step.render} to {step.display}"
        if not keep(f"{step.method} {size}: {step.median:.3f} ms, first {step.first:.1f} s"):
            break
    for other in measure_other_runtimes(names, displays[0], ratios[0], steps=50, on_left_out=options.warn):
        record.others.append(other)
        if not keep(f"{other.method}, {other.runtime}: {other.median:.2f} ms, first {other.first:.1f} s"):
            break
    options.publish(replace(record, provenance=Provenance.now()), "device", json)
