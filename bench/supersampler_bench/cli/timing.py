"""`supersampler bench ...` cost, latency, startup, skip and pareto: how long methods take."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError, DeviceError
from supersampler.frame import Size
from supersampler.model import Precision
from supersampler_bench.cli.options import (
    DISPLAY_SIZE,
    ERRORS,
    EXECUTORS,
    JSON,
    METHODS,
    ONE_RATIO,
    SAMPLES,
    SCENES,
    STEPS,
    UPDATE,
    Tables,
    check_page,
    counted,
    executors_of,
    listed,
    publish,
    say,
    size_pairs_of,
    sizes_of,
    warn,
    words_of,
)
from supersampler_bench.record import SHIPPED_PARETO, read_record

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
    from supersampler_bench.timing import network_cost as bench

    tables = {"cost": bench.markdown_table}
    check_page(update, tables)
    size = parse_size(display_size, "--display-size")
    costs = [bench.measure_cost(name, size) for name in listed(methods)]
    publish(bench.cost_record(costs, size), tables, json, update)


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
    from supersampler_bench.timing.onnx_traffic import count_onnx
    from supersampler_bench.timing.roofline import roofline_table

    tables = {"traffic": bench.markdown_table, "traffic roofline": roofline_table}
    check_page(update, tables)
    names, pairs = listed(methods), size_pairs_of(sizes)
    both = (count_onnx, count_gpu)
    counters = {name: both if parse_spec(name).precision == "auto" else (count_onnx,) for name in names}
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
            results.append((render, display, rows))
    publish(bench.traffic_record(results), tables, json, update)


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
    from supersampler_bench.timing import startup as bench

    tables = {"startup": bench.markdown_table}
    check_page(update, tables)
    names, render = listed(methods), parse_size(render_size, "--render-size")
    with counted("programs", len(names) * (cold + warm)) as advance:
        results = bench.measure_startup(names, render, cold=cold, warm=warm, on_process=advance)
    publish(bench.startup_record(results, render, 2.0), tables, json, update)


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

    tables = {"latency": bench.markdown_table}
    check_page(update, tables)
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
    publish(bench.latency_record(results, limits, ratio), tables, json, update)


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

    tables = {"against": bench.markdown_table}
    check_page(update, tables)
    rounds = bench.Rounds(**taken)
    with counted("rounds", len(methods) * rounds.total(len(displays) * len(threads))) as advance:
        sides, results = bench.measure_against(
            python, methods, displays, threads, ratio=ratio, rounds=rounds, on_round=advance, on_left_out=warn
        )
    publish(bench.against_record(sides, results, ratio, rounds), tables, json, update)


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

    tables = {"skip": bench.markdown_table}
    check_page(update, tables)
    families, names, size = listed(scenes), listed(methods), parse_size(display_size, "--display-size")
    with counted("frames", len(bench.MOVES) * len(families) * bench.frame_count(ratio)) as advance:
        results = bench.measure_skipping(
            families, names, size, ratio=ratio, samples=samples, on_frame=advance
        )
    publish(bench.skip_record(results, size, ratio), tables, json, update)


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
    from supersampler_bench.compatibility import gbuffers_of
    from supersampler_bench.timing import pareto as bench
    from supersampler_bench.timing import pareto_extrapolated as extrapolated

    tables: Tables = {
        "pareto": bench.markdown_table,
        "presets": bench.preset_table,
        "pareto unshaded": extrapolated.unshaded_table,
    }
    check_page(update, tables)
    records, size = (
        [read_record(path) for path in quality or [SHIPPED_PARETO]],
        parse_size(display_size, "--display-size"),
    )
    scored = [record for record in records if record["bench"] != extrapolated.BENCH]
    with counted("rounds", (2 * len(bench.scores_of(scored)) + 1) * steps) as advance:
        points = bench.measure_pareto(
            scored, size, threads=threads, steps=steps, on_left_out=warn, on_round=advance
        )
        unshaded = extrapolated.measure_unshaded(
            records, size, threads=threads, steps=steps, on_round=advance
        )
    record = bench.pareto_record(points, bench.shots_of(scored[0]), size, threads, unshaded)
    publish(record, tables, json, update)
    if output is not None:
        from supersampler_bench.report.figures import draw_pareto  # needs matplotlib

        draw_pareto(points, f"{display_size}, {threads} threads", output)
    if budget_ms is not None:
        best = bench.best_within(points, budget_ms)
        for point in best:
            reads = " (reads G-buffers)" if gbuffers_of([point.spec.model]) else ""
            say(f"ratio {point.ratio:g}: {point.spec}{reads}, {point.milliseconds:.1f} ms")
        if not best:
            say(f"no setting takes {budget_ms:g} ms or less")
            raise typer.Exit(1)
