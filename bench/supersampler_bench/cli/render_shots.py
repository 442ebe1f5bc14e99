"""`supersampler bench shots` and `product-shot`: render the test shots, and the shot that is shipped."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from supersampler_bench.cli.options import ERRORS
from supersampler_bench.cli.shots import CACHE_HELP, found_test_shots, warn_of
from supersampler_bench.shots import public_shots
from supersampler_bench.shots.public_shots import PublicShot


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
    the frozen ones; another driver renders slightly different pixels, which gives a warning.
    """
    from supersampler_bench.shots.render_test_shots import frames_there, render_test_shots

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


def _hashes(found: list[PublicShot]) -> Table:
    table = Table("shot", "ratio", "pixels (SHA-256)", "as frozen", caption=found[0].driver)
    for shot in found:
        table.add_row(shot.shot.name, f"{shot.ratio:g}", shot.digest[:16], "yes" if shot.as_frozen else "no")
    return table


@contextmanager
def _progress(text: str, total: int, done: int = 0) -> Iterator[Callable[[int], None]]:
    """Show how far a long run is and how long it will take; yields what is called with the number done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERRORS, disable=not ERRORS.is_terminal) as progress:
        task = progress.add_task(text, total=total, completed=done)
        try:
            yield lambda count: progress.update(task, completed=count)
        except KeyboardInterrupt:
            ERRORS.print("Stopped. The same command, given again, goes on.")
            raise
