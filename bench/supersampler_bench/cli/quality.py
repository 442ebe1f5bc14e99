"""`supersampler bench` commands about images: quality, extrapolation, denoise, still, parity, test shots."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.table import Table

from supersampler import ArgumentError
from supersampler.cli.arguments import ConventionsOption, SourceOptions, folder_path, open_with, parse_size
from supersampler.cli.terminal import Terminal, echo
from supersampler_bench.cli import options
from supersampler_bench.record import read_record, write_json
from supersampler_bench.shots import public_shots


def quality(
    shot: options.SHOT,
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, comma-separated; NAME:fp32, NAME:fp16 for a graph, "
            "NAME:gpu for shaders, NAME:x2 for two passes, NAME:native for frames of display size; "
            "easu, easu-rcas, fsr2-like."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier-small,classifier,classifier-large",
    ratio: options.RATIO = None,
    cache: options.CACHE = None,
    cvvdp: Annotated[
        bool, typer.Option("--cvvdp", help="Also measure ColorVideoVDP, which takes seconds per image.")
    ] = False,
    json: options.JSON = None,
) -> None:
    """Compare the images of methods with a shot's references.

    Metrics: PSNR, SSIM and FLIP of frames; tPSNR, warped error and STRRED of changes between frames; PSNR of
    disoccluded, aliased and moving pixels, of pixels under changing light, and of first images after a cut;
    predicted and true classes. On thin_movers and moving_shadows also trails, kept coverage of thin objects,
    shadow edges, speckle, and the error by kind of pixel. All are of display values: exposed, tone mapped,
    sRGB encoded. docs/quality.md describes each. Methods that do not support a shot's ratio or G-buffers are
    left out.

    \b
    Examples:
      supersampler bench quality plaza --methods bilinear,taau
      supersampler bench quality test-shots --ratio 1.5,2,3,4 --json results.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality.color_video_vdp import metric
    from supersampler_bench.quality.measure import measure_quality, runnable
    from supersampler_bench.quality.score_table import QualityRecord, terminal_tables
    from supersampler_bench.quality.scores import shot_row

    if cvvdp:
        metric()  # fails before the measurement, which takes minutes
    _, opened = options.opened_shots(shot, cache, ratio)
    rows = []
    for one, origin in opened:
        names = runnable(one, options.split_list(methods), options.warn)
        with options.counted(one.name, len(one)) as advance:
            rows.append(shot_row(one, measure_quality(one, names, cvvdp=cvvdp, on_frame=advance), origin))
    record = QualityRecord.of(rows)
    console = Terminal()
    for titled in [*record.shot_tables(), *record.mean_tables().values()]:
        console.print(*terminal_tables(*titled))
    if json is not None:
        write_json(record, json)


def extrapolation(
    shot: options.SHOT,
    methods: options.METHODS = "classifier,taau",
    models: Annotated[
        str, typer.Option(help="Extrapolation models, shipped ones or model folders, comma-separated.")
    ] = "guided-warp",
    alternation: Annotated[
        str, typer.Option(help="Ratios of unshaded to shaded frames, comma-separated.")
    ] = "1:1,2:1",
    ratio: options.RATIO = None,
    cache: options.CACHE = None,
    json: options.JSON = None,
) -> None:
    """Remove the colour of every second frame, or of two of three, and score their images.

    Compares extrapolation by each model, upscaled by each method; the last image, warped by motion; the same
    with disoccluded pixels filled from the background; and, as the limit, all frames shaded. Scores are of
    the unshaded frames; tPSNR is of all. Frames need the G-buffers that the models read.

    \b
    Examples:
      supersampler bench extrapolation test-shots
      supersampler bench extrapolation my_shot --methods taau --alternation 2:1 --json mine.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality import extrapolation as bench

    name, opened = options.opened_shots(shot, cache, ratio)
    upscalers, extrapolators, alternations = map(options.split_list, (methods, models, alternation))
    measured = []
    with options.counted("frames", len(alternations) * sum(len(one) for one, _ in opened)) as advance:
        for one, origin in opened:
            scores = bench.measure_extrapolation(
                one, upscalers, extrapolators, alternations, on_left_out=options.warn, on_frame=advance
            )
            measured.append(bench.unshaded_row(one, scores, origin))
    record = bench.ExtrapolationRecord.of(measured, extrapolators)
    options.publish(record, f"extrapolation {name}", json)


def denoise(
    renders: Annotated[
        list[Path],
        typer.Argument(
            metavar="RENDER",
            help="Folders of a path tracer's frames, named SCENE-SAMPLES: room-4 has 4 samples per pixel.",
        ),
    ],
    reference: Annotated[
        str,
        typer.Option(
            metavar="PATTERN",
            help="EXR files of the references, relative to the folder that holds RENDER; {scene} is its "
            "scene. Files of one frame are averaged.",
        ),
    ] = options.REFERENCES,
    per_frame: Annotated[
        Literal["auto", "oidn", "none"],
        typer.Option(help="Denoiser of single frames, as in `supersampler denoise`."),
    ] = "auto",
    conventions: ConventionsOption = None,
    json: options.JSON = None,
) -> None:
    """Compare the temporal denoiser with its per-frame denoiser, against references of some frames.

    Compares each frame denoised by itself; the median of it and its neighbours, aligned by motion; and the
    temporal filter with one pass and with two. PSNR, tPSNR and FLIP are of sRGB values, without exposure or
    tone curve. tPSNR needs references of consecutive frames. Pixels of a reference are missing if they are
    NaN, or 0 in colour and alpha; pixels within 8 pixels of missing ones or of the edge are not scored.
    References with Denoising Albedo and Denoising Normal are denoised, too. A file costs.jsonl in RENDER,
    with lines {"frame": 16, "cpu": 10.5}, gives the CPU seconds of the renderer.

    \b
    Examples:
      supersampler bench denoise room-1 room-4 --json denoise.json
      supersampler bench denoise renders/room-4 --reference "truth/*.exr"
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler.denoising.oidn import Oidn
    from supersampler_bench.quality.denoise import measure_render, scene_and_samples, span_of
    from supersampler_bench.quality.denoise_record import DenoiseRecord
    from supersampler_bench.quality.denoise_references import find_references

    source = SourceOptions(conventions=conventions)
    folders = [folder.absolute() for folder in renders]  # "." has neither a name nor a parent
    shots = [open_with(str(folder), source, guides="denoising") for folder in folders]
    files = [find_references(folder, scene_and_samples(folder)[0], reference) for folder in folders]
    total = sum(len(span_of(*pair)) for pair in zip(shots, files, strict=True))
    rows = []
    with options.counted("frames", total) as advance:
        for folder, shot, found in zip(folders, shots, files, strict=True):
            comes_denoised = shot.is_denoised if per_frame == "auto" else per_frame == "none"
            with nullcontext() if comes_denoised else Oidn(threads=1) as denoiser:
                rows.append(measure_render(folder, shot, found, denoiser, on_frame=advance))
            if json is not None:  # a stopped run keeps what it has measured
                write_json(DenoiseRecord(rows), json)
    options.publish(DenoiseRecord(rows), "denoise", json)


def still(
    scenes: Annotated[
        str, typer.Option(help="SCENE:RATIO, such as analytic:2, court:2; court-mover has moving objects.")
    ] = "analytic:1,analytic:1.5,analytic:2,analytic:3,analytic-mover:2,court:2,gallery:2,court-mover:2",
    methods: options.METHODS = "taa,taau,classifier-small,classifier",
    executors: options.EXECUTORS = "cpu,onnx",
    display_size: options.DISPLAY_SIZE = "320x180",
    samples: options.SAMPLES = 64,
    output: options.FIGURES = None,
    json: options.JSON = None,
) -> None:
    """Measure the PSNR of scenes with a fixed camera after 1, 2 and 4 jitter periods.

    The figure, still.png, has curves over the frames. Test shots are rendered here, with OpenGL.

    \b
    Examples:
      supersampler bench still --scenes analytic:2 --methods taau
      supersampler bench still -o docs/images --json still.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench.quality.still import StillRecord, frame_count, measure_still

    chosen, display = _scenes_of(scenes), parse_size(display_size, "--display-size")
    names, kinds = options.split_list(methods), options.executors_of(executors)
    with options.counted("frames", sum(frame_count(ratio) for _, ratio in chosen)) as advance:
        results = measure_still(chosen, names, display, executors=kinds, samples=samples, on_frame=advance)
    record = StillRecord(display, results)
    options.publish(record, "still", json)
    if output is not None:
        from supersampler_bench.report import figures

        figures.draw_still(record, output / "still.png")
        options.say(str(output / "still.png"))


def _scenes_of(text: str) -> list[tuple[str, float]]:
    """Return names and ratios of scenes."""
    from supersampler_bench.quality.still import SCENES

    found = []
    for part in options.split_list(text):
        name, _, ratio = part.partition(":")
        options.words_of("--scenes", name, SCENES)
        try:
            found.append((name, float(ratio)))
        except ValueError as error:
            raise ArgumentError("--scenes", got=repr(part), want="SCENE:RATIO, as analytic:2") from error
    return found


def parity(
    methods: Annotated[
        str, typer.Option(help="Names of shipped models, comma-separated.")
    ] = "taa,taau,classifier-small,classifier,classifier-large,gbuffer-fast",
    frames: Annotated[int, typer.Option(min=10, help="Consecutive frames at each size.")] = 200,
    json: options.JSON = None,
) -> None:
    """Compare the backends with torch over a long sequence, which is rendered here, with OpenGL.

    \b
    Example:
      supersampler bench parity --methods classifier --frames 300
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench import parity as bench

    names = options.split_list(methods)
    with options.counted("frames", len(bench.methods_by_size(names)) * frames) as advance:
        results = bench.measure_parity(names, frames, on_frame=advance)
    options.publish(bench.ParityRecord(results), "parity", json)


def hashes(
    methods: Annotated[
        str | None, typer.Option(help="Names of shipped models, comma-separated.", show_default="all")
    ] = None,
    check: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="Compare with this earlier record; fail where anything differs."),
    ] = None,
    json: options.JSON = None,
) -> None:
    """Hash every image and the last history of the shipped models, in every way that they run on a CPU.

    Hashes depend on the processor, on ONNX Runtime and on the compiler: compare records of one machine.

    \b
    Examples:
      supersampler bench hashes --json before.json
      supersampler bench hashes --check before.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_bench import hashes as bench

    before = None if check is None else bench.HashesRecord.from_json(read_record(check))
    runs = bench.subjects(None if methods is None else options.split_list(methods))
    with options.counted("runs", len(bench.SIZES) * len(runs)) as advance:
        here = bench.HashesRecord.of(bench.measure_hashes(runs, bench.SIZES, on_run=advance))
    if json is not None:
        write_json(here, json)
    if before is None:
        return
    found = list(bench.differences(before, here, partly=methods is not None))
    for text in found:
        echo(text)
    options.say(f"{len(here.hashed)} runs: {len(found)} differ from {check}")
    if found:
        if unlike := bench.unlike_versions(before, here):
            options.warn(f"recorded with {unlike}: hashes may differ for that reason alone")
        raise typer.Exit(1)


def shots(
    cache: options.CACHE_ARGUMENT = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Make these pixels the frozen ones, for published figures.")
    ] = False,
) -> None:
    """Render the public test shots at ratios 1 to 4, and check their pixels.

    Every frame has a reference of 64 samples per pixel, truth classes, and G-buffers of both sizes. The same
    command continues a stopped run. A warning names shots whose pixels differ from the frozen hashes: another
    driver renders slightly different ones.
    """
    from supersampler_bench.shots.rendering import frames_there, render_test_shots

    folder = cache or public_shots.default_cache()
    plans = (public_shots.TEST_SHOTS, *public_shots.APART_SHOTS)
    total = sum(plan.frames * len(plan.seeds) for plan in plans)
    done = sum(frames_there(folder, plan) for plan in plans)
    with options.counted("rendering", total, done, resumes=True) as advance:
        for plan in plans:
            render_test_shots(folder, plan, workers=workers, on_frame=advance)
    found = [
        shot
        for plan in plans
        for shot in public_shots.open_test_shots(folder, plan.ratios, plan, public_shots.FROZEN)
    ]
    if freeze:
        found = public_shots.freeze(found, public_shots.FROZEN)
    table = Table("shot", "ratio", "pixels (SHA-256)", "as frozen", caption=found[0].driver)
    for shot in found:
        table.add_row(shot.shot.name, f"{shot.ratio:g}", shot.digest[:16], "yes" if shot.as_frozen else "no")
    Terminal().print(table)
    for warning in filter(None, (shot.warning() for shot in found)):
        options.warn(warning)
    options.say(f"{len(found)} shots in {folder / public_shots.NAME}")


def product_shot(
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUTPUT",
            parser=folder_path,
            help="Folder to write; it ships as sdk/supersampler/shots/plaza.",
        ),
    ],
) -> None:
    """Render the shot that ships with the package."""
    from supersampler_model.data.product_shot import FRAMES, render_product_shot

    with options.counted("rendering", FRAMES, resumes=True) as advance:
        render_product_shot(output, on_frame=advance)
