"""`supersampler bench ...`; the main command finds `app` by this module's name."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from supersampler.cli.arguments import parse_size
from supersampler.errors import ArgumentError
from supersampler.io.shot import Shot
from supersampler_bench import (
    cli_extrapolation,
    cli_hashes,
    cli_pareto,
    cli_report,
    cli_run,
    cli_stress,
    color_video_vdp,
    public_shots,
)
from supersampler_bench.class_table import rich_class_table
from supersampler_bench.cli_shared import ERRORS, JSON, UPDATE, check_page, listed, publish, warn
from supersampler_bench.cli_shots import (
    CACHE,
    CACHE_HELP,
    RATIO,
    SHOT,
    found_test_shots,
    opened_shots,
    warn_of,
)
from supersampler_bench.error_maps import ErrorMaps
from supersampler_bench.public_shots import PublicShot
from supersampler_bench.quality import measure_quality, runnable
from supersampler_bench.record import Measured, quality_record, write_json
from supersampler_bench.report import Report, block_names
from supersampler_bench.table import find_blocks, rich_table, update_blocks

if TYPE_CHECKING:
    from supersampler_bench.gallery import Gallery

app = typer.Typer(no_args_is_help=True)


@app.callback()
def bench() -> None:
    """Measure methods on shots with references; every published number comes from here."""


for _command in (
    cli_run.cost,
    cli_run.parts,
    cli_run.speed,
    cli_run.start,
    cli_run.device,
    cli_run.skip,
    cli_run.parity,
    cli_run.precision,
    cli_run.compare,
    cli_hashes.hashes,
    cli_pareto.pareto,
    cli_pareto.suggest,
    cli_stress.stress,
    cli_extrapolation.extrapolation,
    cli_extrapolation.drawn,
    cli_report.tables,
    cli_report.report,
):
    app.command()(_command)


@app.command()
def quality(
    shot: SHOT,
    methods: Annotated[
        str,
        typer.Option(
            help="Shipped models or model folders, with commas between; NAME:fp32, NAME:fp16 for a graph."
        ),
    ] = "bilinear,bicubic,taa,taau,classifier,classifier-small",
    ratio: RATIO = "2",
    cache: CACHE = None,
    cvvdp: Annotated[
        bool, typer.Option("--cvvdp", help="Judge clips by ColorVideoVDP, too; takes its package.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Folder for curves over the frames, error heat maps, classes."),
    ] = None,
    json: JSON = None,
    update: Annotated[
        list[Path] | None,
        typer.Option(help="Rewrite the tables between this Markdown file's bench marks; any number."),
    ] = None,
) -> None:
    """Compare the pictures of methods with a shot's references.

    PSNR, SSIM and FLIP of frames; tPSNR, warped error and STRRED of changes from frame to frame; PSNR where
    something was hidden a frame ago, where the light changes, where one sample does not tell the colour, and
    where the picture moves; and what a classifier took pixels for. All on pictures as a screen shows them:
    exposed, tone mapped, sRGB. For the test shots, a table of each and of their mean. docs/quality.md has
    what each metric is. Methods that cannot draw a shot, at its ratio or without its G-buffers, are left out.

    \b
    Examples:
      supersampler bench quality plaza --methods bilinear,taau --update README.md
      supersampler bench quality my_shot -o errors
      supersampler bench quality test-shots --ratio 1.5,2,3,4 --json results.json
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    gallery = None if output is None else _gallery(output)
    if cvvdp:
        color_video_vdp.require()  # what fails does so now, not after minutes of measuring
    name, opened = opened_shots(shot, cache, ratio)
    for page in update or []:
        find_blocks(page, block_names(f"quality {name}"))
    names = listed(methods)
    report = Report(quality_record([_measured(one, origin, names, cvvdp, gallery) for one, origin in opened]))
    if gallery is not None:
        gallery.add_means(report)
    console = Console()
    for title, scores in [*report.shot_tables(), *report.mean_tables()]:
        console.print(rich_table(title, scores))
        if (table := rich_class_table(title, scores)) is not None:
            console.print(table)
    if json is not None:
        write_json(report.record, json)
    for page in update or []:
        update_blocks(page, report.blocks(f"quality {name}"))


def _measured(
    shot: Shot, origin: dict[str, Any], methods: list[str], cvvdp: bool, gallery: "Gallery | None"
) -> Measured:
    methods = runnable(shot, methods, warn)
    maps = ErrorMaps(methods)
    with Progress(console=ERRORS, transient=True, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task(shot.name, total=len(shot))
        results = measure_quality(
            shot,
            methods,
            cvvdp=cvvdp,
            watch=(lambda _: None) if gallery is None else maps,
            on_frame=lambda n: progress.update(task, completed=n),
        )
    measured = Measured(shot, results, origin)
    if gallery is not None:
        gallery.add(measured, maps)
    return measured


def _gallery(folder: Path) -> "Gallery":
    from supersampler_bench.gallery import Gallery  # needs matplotlib

    return Gallery(folder)


@app.command()
def ablation(
    method: Annotated[str, typer.Argument(metavar="METHOD", help="classifier or gbuffer-small-4x.")],
    data: Annotated[list[Path], typer.Option(help="Training set with validation sequences; any number.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the runs.")],
    steps: Annotated[int, typer.Option(min=1, help="Updates of each run.")] = 800,
    workers: Annotated[int, typer.Option(min=1, help="Runs at a time, a thread each.")] = 1,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Train METHOD with one choice changed at a time, briefly, and compare on validation sequences.

    A run that was stopped goes on when the same command is given again.

    Examples:
      supersampler bench ablation classifier --data data -o ablation --workers 2 --update docs/methods.md
      supersampler bench ablation gbuffer-small-4x --data data -o ablation-gbuffer --steps 250
    """
    from supersampler_bench.ablation import SUBJECTS, Ablation, ablation_record, markdown_table, run_ablation

    if method not in SUBJECTS:
        raise ArgumentError("METHOD", got=method, want=f"one of {', '.join(SUBJECTS)}")
    tables = {f"ablation {method}": markdown_table}
    check_page(update, tables)
    plan = Ablation(method, data=data, folder=output, steps=steps, workers=workers)
    rows = run_ablation(plan, lambda r: ERRORS.print(f"{r.name}: {r.psnr:.2f} dB, tPSNR {r.tpsnr:.2f} dB"))
    publish(ablation_record(rows, plan), tables, json, update)


@app.command()
def shots(
    cache: Annotated[
        Path | None,
        typer.Argument(
            envvar=public_shots.CACHE_VARIABLE, help=CACHE_HELP, show_default="the user's cache folder"
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Make these pixels the ones that figures are published for.")
    ] = False,
) -> None:
    """Render the five public test shots, 40 frames each at ratios 1.5, 2, 3 and 4, and check their pixels.

    Each has references of 64 samples a pixel, truth classes, and G-buffers of both sizes on every frame. A
    run that was stopped goes on when the same command is given again. The pixels' hashes are compared with
    the frozen ones; other drivers than theirs draw slightly other pixels, which is said.
    """
    from supersampler_bench.render_shots import frames_there, render_test_shots

    folder, plan = cache or public_shots.default_cache(), public_shots.TEST_SHOTS
    total = plan.frames * len(plan.seeds)
    with _progress("rendering", total, frames_there(folder, plan)) as update:
        render_test_shots(folder, plan, workers=workers, on_progress=update)
    found = found_test_shots(folder, plan.ratios)
    if freeze:
        found = public_shots.freeze(found, public_shots.FROZEN)
    Console().print(_hashes(found))
    warn_of(found)
    ERRORS.print(f"{len(found)} shots in {folder / public_shots.NAME}")


@app.command("product-shot")
def product_shot(
    output: Annotated[
        Path, typer.Argument(help="Folder to write; it ships as sdk/supersampler/shots/plaza.")
    ],
) -> None:
    """Render the shot that ships with the package, from its scene in code."""
    from supersampler_model.data.product_shot import FRAMES, render_product_shot

    with _progress("rendering", FRAMES) as update:
        counter = count(1)
        render_product_shot(output, on_frame=lambda: update(next(counter)))


@app.command()
def render(
    size: Annotated[
        str, typer.Option(metavar="WxH", help="Display size; inputs have half of it.")
    ] = "960x540",
    samples: Annotated[int, typer.Option(help="Of the reference, a pixel; a square number.")] = 64,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 2,
    frames: Annotated[int, typer.Option(min=3, help="Of each family and worker.")] = 6,
    json: JSON = None,
) -> None:
    """Measure how many training samples `supersampler render --gbuffers` makes in an hour, by family.

    Renders some of each family to a temporary folder. Keep the machine idle otherwise.
    """
    from supersampler_bench.render_speed import RenderLoad, markdown_table, measure_render

    load = RenderLoad(display_size=parse_size(size), samples=samples, workers=workers, frames=frames)
    with _progress("rendering", load.plan().sequences * frames) as update:
        counter = count(1)
        record = measure_render(load, lambda: update(next(counter)))
    Console().print(markdown_table(record), markup=False, soft_wrap=True)
    if json is not None:
        write_json(record, json)


def _hashes(found: list[PublicShot]) -> Table:
    table = Table("shot", "ratio", "pixels (SHA-256)", "as frozen", caption=found[0].driver)
    for shot in found:
        table.add_row(shot.shot.name, f"{shot.ratio:g}", shot.digest[:16], "yes" if shot.as_frozen else "no")
    return table


@contextmanager
def _progress(text: str, total: int, done: int = 0) -> Iterator[Any]:
    """Show how far a long run is and how long it will take; yields what is called with the number done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERRORS, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task(text, total=total, completed=done)
        try:
            yield lambda count: progress.update(task, completed=count)
        except KeyboardInterrupt:
            ERRORS.print("Stopped. The same command, given again, goes on.")
            raise
