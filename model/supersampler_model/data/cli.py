"""`supersampler render OUT`. Heavy modules are imported when the command runs, not for --help."""

from pathlib import Path
from typing import Annotated

import typer

from supersampler.cli.arguments import folder_path, parse_size, size_text
from supersampler.cli.terminal import Terminal, counted
from supersampler.errors import ArgumentError
from supersampler_model.data.sequences import APART_FAMILIES, TEST_FAMILIES, TRAIN_FAMILIES

app = typer.Typer(
    help="Render a training set with exact truth and labels.", add_completion=False, rich_markup_mode=None
)
GLTF_FRACTION = 0.3
_FAMILIES = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)


@app.command()
def render(
    output: Annotated[Path, typer.Argument(metavar="OUT", parser=folder_path, help="Folder of the set.")],
    families: Annotated[
        str, typer.Option("--scenes", help=f"`train`, `test`, or some of {', '.join(_FAMILIES)}.")
    ] = "train",
    sequences: Annotated[int, typer.Option(help="Number of sequences.")] = 60,
    frames: Annotated[int, typer.Option(help="Frames per sequence.")] = 25,
    display_size: Annotated[str, typer.Option(metavar="WxH", help="Size of the references.")] = "640x360",
    ratios: Annotated[
        str, typer.Option("--ratio", help="Display over render size, chosen at random from these.")
    ] = "1,1.5,2,3,4",
    also: Annotated[
        str, typer.Option(help="Render every sequence at these ratios, too; references are shared.")
    ] = "",
    samples: Annotated[int, typer.Option(help="Samples per pixel of references; a square number.")] = 64,
    gbuffers: Annotated[bool, typer.Option(help="Keep display-size G-buffers, too.")] = False,
    gltf: Annotated[
        Path | None, typer.Option(help="Folder of .glb and .gltf files, and .hdr panoramas, to compose from.")
    ] = None,
    gltf_fraction: Annotated[
        float, typer.Option(help="Fraction of the sequences that are composed of the files in --gltf.")
    ] = GLTF_FRACTION,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same set.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    show_labels: Annotated[
        bool, typer.Option(help="Write class maps of each sequence to OUT/labels.")
    ] = False,
) -> None:
    """Render OUT, a training set: frames, references of many samples a pixel, and labels, split by scene.

    The same command resumes a stopped run; --also may be added then.

    With --gltf, files at least 8 m wide are stages, and the others are props on them. All files are read
    before rendering begins. A quarter of the files of each kind (stage, prop, panorama) is only used in
    validation sequences; a single file is used for training.

    \b
    Examples:
      supersampler render data --sequences 60 --frames 25 --workers 2
      supersampler render data --scenes fences,floors --show-labels
      supersampler render data --gbuffers --also 2,4
      supersampler render data --gltf my/scenes --gltf-fraction 0.3
    """  # noqa: D301  # \b is click's mark for lines that are not to be joined
    from supersampler_model.data.dataset import rendering
    from supersampler_model.data.dataset.overview import write_class_maps
    from supersampler_model.data.dataset.storage import create_dataset

    if gltf is None and gltf_fraction != GLTF_FRACTION:
        raise ArgumentError("--gltf-fraction", got=gltf_fraction, want="none without --gltf")
    groups = {"train": TRAIN_FAMILIES, "test": TEST_FAMILIES}
    plan = rendering.RenderPlan(
        families=groups.get(families, tuple(name.strip() for name in families.split(","))),
        sequences=sequences,
        frames=frames,
        display_size=parse_size(display_size, "--display-size"),
        ratios=_numbers("--ratio", ratios),
        samples=samples,
        gbuffers=gbuffers,
        seed=seed,
        gltf=gltf,
        gltf_fraction=gltf_fraction,
    )
    console = Terminal(stderr=True)
    others = _numbers("--also", also) if also else []
    if others:
        rendering.check_ratios("--also", others, plan.display_size)
    turns = [None, *others]
    dataset = create_dataset(
        output, rendering.plan_sequences(plan, lambda text: console.print(text, soft_wrap=True))
    )
    sets = [dataset, *(dataset.at(ratio) for ratio in turns if ratio)]
    total = len(turns) * sum(entry.spec.frames for entry in dataset.entries())
    done = sum(one.complete(entry) for one in sets for entry in one.entries())
    with counted(console, "rendering", total, done, resumes=True) as advance:
        for turn in turns:
            rendering.render_dataset(dataset, ratio=turn, workers=workers, on_frame=advance)
    if show_labels:
        write_class_maps(dataset, output / "labels")
    console.print(f"{total} frames of {size_text(dataset.description.display_size)} in {output}")


def _numbers(name: str, text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ArgumentError(name, got=repr(text), want="comma-separated numbers, such as 1.5,2") from None
