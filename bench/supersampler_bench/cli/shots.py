"""`supersampler bench shots` and `product-shot`: render the test shots, and the shot that is shipped."""

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from supersampler.cli.terminal import Terminal
from supersampler_bench.cli.options import CACHE_ARGUMENT, counted, say, warn
from supersampler_bench.shots import public_shots


def shots(
    cache: CACHE_ARGUMENT = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    freeze: Annotated[
        bool, typer.Option("--freeze", help="Make these pixels the ones that figures are published for.")
    ] = False,
) -> None:
    """Render the public test shots, 40 frames each at ratios 1 to 4, and check their pixels.

    Each has references of 64 samples a pixel, truth classes, and G-buffers of both sizes on every frame. The
    same command continues a stopped run. The pixels' hashes are compared with the frozen ones; another driver
    renders slightly different pixels, which gives a warning.
    """
    from supersampler_bench.shots.render_test_shots import frames_there, render_test_shots

    folder, plans = cache or public_shots.default_cache(), (public_shots.TEST_SHOTS, public_shots.APART_SHOTS)
    total = sum(plan.frames * len(plan.seeds) for plan in plans)
    done = sum(frames_there(folder, plan) for plan in plans)
    with counted("rendering", total, done, resumes=True) as advance:
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
        warn(warning)
    say(f"{len(found)} shots in {folder / public_shots.NAME}")


def product_shot(
    output: Annotated[
        Path, typer.Argument(help="Folder to write; it ships as sdk/supersampler/shots/plaza.")
    ],
) -> None:
    """Render the shot that ships with the package, from its scene in code."""
    from supersampler_model.data.product_shot import FRAMES, render_product_shot

    with counted("rendering", FRAMES, resumes=True) as advance:
        render_product_shot(output, on_frame=advance)
