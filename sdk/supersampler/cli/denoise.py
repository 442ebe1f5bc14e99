"""`supersampler denoise`: denoises path-traced animations into folders of images."""

from functools import partial
from typing import Annotated, Literal

import typer

from supersampler.cli import arguments
from supersampler.cli.arguments import open_with, source_notes, with_option_groups
from supersampler.cli.terminal import Terminal, echo

_RUN_OPTIONS = (
    "output", "per_frame", "passes", "lookahead", "samples", "threads", "overwrite", "json",
)  # fmt: skip
"""Parameters that are passed to `DenoiseRun` unchanged."""


@with_option_groups
def denoise(
    *,
    shot: Annotated[
        str,
        typer.Argument(
            metavar="SHOT", help="A shot, a folder of frames, or a pattern such as beauty.####.exr."
        ),
    ],
    output: arguments.OutputOption,
    per_frame: Annotated[
        Literal["auto", "oidn", "none"],
        typer.Option(
            help="Denoiser of single frames. oidn: Open Image Denoise; from frames that Cycles has denoised, "
            "it reads Noisy Image. none: the frames are denoised already. auto: oidn where it is installed."
        ),
    ] = "auto",
    passes: Annotated[
        int,
        typer.Option(
            min=1, max=2, help="2: average with previous and following frames. 1: with previous frames."
        ),
    ] = 2,
    lookahead: Annotated[
        int | None,
        typer.Option(help="With --passes 2: number of following frames.", show_default="all that help"),
    ] = None,
    samples: Annotated[
        float | None,
        typer.Option(
            help="Samples per pixel of the frames: the more, the less is averaged.",
            show_default="those of Cycles' frames, otherwise 8",
        ),
    ] = None,
    frames: arguments.FramesOption = None,
    files: arguments.FileOptions,
    source: arguments.SourceOptions,
    threads: arguments.ThreadsOption = 0,
    overwrite: arguments.OverwriteOption = False,
    json: arguments.JsonOption = False,
) -> None:
    """Denoise SHOT, the frames of a path tracer, into a folder of images of the same size.

    Noise is averaged over neighbouring frames, along their motion, before a denoiser removes it. An image
    depends on up to 5 previous and 5 following frames. Frames need colour, depth and motion; albedo and
    normal keep edges sharp. Alpha and AOVs are averaged with the same weights. A missing frame is a cut. The
    same command resumes a stopped run.

    \b
    Examples:
      supersampler denoise renders -o out
      supersampler denoise "renders/beauty.####.exr" -o out --conventions blender --frames 100-199
      supersampler denoise renders -o out --per-frame none --compare
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.cli.denoise_run import DenoiseRun, copied_ids, parts_of
    from supersampler.cli.results import ImageOptions
    from supersampler.io.shot.numbered import FrameRange

    given = dict(locals())
    numbers = None if frames is None else FrameRange.parse(frames, "--frames")
    console = Terminal(stderr=True)
    open_frames = partial(open_with, shot, source, guides="denoising")
    for part, opened, note in parts_of(numbers, open_frames, passes):
        images = ImageOptions.of(files, opened)
        copied = copied_ids(opened) if "exr" in images.formats else []
        notes = [note, *source_notes(opened, copied), *files.unused(images.formats, passes=passes)]
        if (used := images.compression_with(copied)) != files.compression:
            notes.append(
                f"The compression of EXR files is {used}: {files.compression} would change the copied ids."
            )
        for line in filter(None, notes):
            console.print(line, soft_wrap=True)
        run = DenoiseRun(
            shot=opened, source=source.to_json(), images=images, numbers=part,
            compare=files.compare, console=console, **{key: given[key] for key in _RUN_OPTIONS},
        )  # fmt: skip
        results = run.write()
        if images.video and not json:
            echo(f"Video: {output / results.record.video}")
        if files.compare and not json:
            echo(f"Open in a browser: {output / results.record.page}")
