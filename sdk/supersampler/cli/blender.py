"""`supersampler blender`: renders a .blend file, and denoises or upscales the frames as they are rendered."""

from collections.abc import Callable, Iterable
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from supersampler.cli.arguments import Compare, Format, OutputOption, parse_size
from supersampler.cli.terminal import Terminal, echo
from supersampler.errors import ArgumentError

if TYPE_CHECKING:
    from supersampler.integrations.blender.render import RenderRequest
    from supersampler.io.display_transforms import DisplayTransform
    from supersampler.io.shot.blender import RenderedScene


def blender(
    scene_file: Annotated[Path, typer.Argument(metavar="SCENE.blend", help="The file; it is never written.")],
    output: OutputOption,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST-LAST", help="Frames, 1-48.", show_default="the scene's")
    ] = None,
    display_size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Size of the results.", show_default="the scene's resolution"),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(help="Upscale: display over render size, 1.0 to 4.0.", show_default="2 to upscale"),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(
            min=1, help="Samples per render pixel.", show_default="the scene's; 16 in Cycles to upscale"
        ),
    ] = None,
    denoise: Annotated[
        Literal["temporal", "frame", "off"] | None,
        typer.Option(
            help="temporal: render at full size, denoise in Cycles and over time. frame, off: upscale; "
            "Cycles denoises, or not.",
            show_default="temporal in Cycles; frame with --scale",
        ),
    ] = None,
    keep_blur: Annotated[
        bool,
        typer.Option("--keep-blur", help="With --denoise temporal: render motion blur and depth of field."),
    ] = False,
    engine: Annotated[
        Literal["cycles", "eevee", "workbench"] | None,
        typer.Option(help="Render engine.", show_default="the scene's"),
    ] = None,
    blender: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="Blender, or a Python with bpy.", show_default="searched for"),
    ] = None,
    camera: Annotated[str | None, typer.Option(help="Name of a camera.", show_default="the scene's")] = None,
    scene: Annotated[str | None, typer.Option(help="Name of a scene.", show_default="the active one")] = None,
    view_layer: Annotated[
        str | None, typer.Option(help="Name of a view layer.", show_default="the first that is on")
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(help="Upscale: a shipped model by name.", show_default="classifier to upscale"),
    ] = None,
    format: Annotated[  # noqa: A002  # the option's name
        list[Format] | None,
        typer.Option(
            help="exr: linear half floats. png: as Blender's view transform shows it. Repeat it for both.",
            show_default="exr",
        ),
    ] = None,
    composite: Annotated[
        bool,
        typer.Option("--composite", help="Then run the file's compositor on the results: OUTPUT/composited."),
    ] = False,
    motion_blur: Annotated[
        bool,
        typer.Option("--motion-blur", help="With --denoise temporal: add motion blur, in OUTPUT/composited."),
    ] = False,
    depth_of_field: Annotated[
        bool,
        typer.Option(
            "--depth-of-field", help="With --denoise temporal: add depth of field, in OUTPUT/composited."
        ),
    ] = False,
    advise: Annotated[
        bool,
        typer.Option("--advise", help="Cycles: only try each way on a few small frames, and recommend one."),
    ] = False,
    compare: Compare = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the render and the results of an earlier run.")
    ] = False,
) -> None:
    """Render SCENE.blend, and denoise or upscale each frame while the next ones render.

    Cycles renders at full size, and the frames are denoised over time. Other engines, and Cycles with
    --scale, render small and with jitter, and the frames are upscaled. Blender runs in the background, in its
    own process. Its rendered frames go to OUTPUT/render, the results to OUTPUT; both keep Blender's frame
    numbers. Motion blur, depth of field and compositing are turned off in the render, with a message;
    Blender can add them to the results. The same command resumes a stopped run.

    \b
    Examples:
      supersampler blender kitchen.blend -o out --frames 1-48
      supersampler blender kitchen.blend -o out --samples 8 --denoise temporal --format png
      supersampler blender kitchen.blend -o out --scale 2 --display-size 3840x2160 --samples 16
      supersampler blender kitchen.blend -o out --composite --motion-blur --depth-of-field
      supersampler blender kitchen.blend -o out --advise
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.cli.denoise_run import DenoiseRun
    from supersampler.cli.results import ImageOptions
    from supersampler.cli.upscale_run import UpscaleRun
    from supersampler.integrations.blender.composite import composite as composite_frames
    from supersampler.integrations.blender.render import RenderRequest, rendering
    from supersampler.io.shot.numbered import FrameRange
    from supersampler.methods.model_file import find_model, read_model_info

    formats = [str(item) for item in format or [Format.exr]]
    console = Terminal(stderr=True)
    if method is not None:
        if denoise == "temporal":
            raise ArgumentError("--method", got="given with --denoise temporal", want="one of the two")
        scale = 2.0 if scale is None else scale  # the frames are upscaled, also in Cycles
    if scale is not None:
        name = "classifier" if method is None else method
        low, high = read_model_info(find_model(name)).ratios
        if not low <= scale <= high:
            raise ArgumentError(
                "--scale", got=f"{scale:g}", want=f"{low:g} to {high:g}, the ratios of {name}"
            )
    request = RenderRequest(
        blend=scene_file,
        frames=None if frames is None else astuple(FrameRange.parse(frames, "--frames", lowest=0)),
        display_size=None if display_size is None else parse_size(display_size, "--display-size"),
        scale=scale,
        samples=samples,
        denoise=denoise,
        engine=engine,
        camera=camera,
        scene=scene,
        view_layer=view_layer,
        keep_blur=keep_blur,
        program=blender,
        composite=composite and not advise,
    )
    note = partial(console.print, soft_wrap=True)
    if advise:
        _advise(request, output / "advise", overwrite=overwrite, note=note)
        return
    blurs = {"motion_blur": motion_blur, "depth_of_field": depth_of_field}
    blurs = {name: True for name, is_on in blurs.items() if is_on}
    if keep_blur and blurs:
        raise ArgumentError("--keep-blur", got=f"given with {_option(blurs)}", want="one of the two")
    if (composite or blurs) and "exr" not in formats:
        hint = "Blender's compositor reads EXR results."
        raise ArgumentError("--format", got=", ".join(formats), want="exr, too", hint=hint)
    with rendering(request, output / "render", overwrite=overwrite, note=note) as render:
        if blurs and render.scene.denoise != "temporal":
            want = "--denoise temporal, whose frames have motion and depth of full size"
            raise ArgumentError(_option(blurs), got="given with upscaled frames", want=want)
        transform, space = _transform_of(render.scene, formats), render.shot.info.known_color_space
        images = ImageOptions(formats=formats, transform=transform, color_space=space)
        same: dict[str, Any] = {
            "shot": render.shot, "output": output, "images": images, "compare": compare,
            "overwrite": overwrite, "holds_shot": True, "console": console,
        }  # fmt: skip
        if render.scene.denoise == "temporal":
            DenoiseRun(**same).write()
        else:
            UpscaleRun(**same, model=method).write()
        if composite or blurs:
            results = output / "exr" if len(images.image_formats) > 1 else output
            folder = output / "composited"
            for path in composite_frames(
                request, render, results, folder, nodes=composite, note=note, **blurs
            ):
                note(f"composited: {path}")
    echo(f"Frames: {output}")


def _option(names: Iterable[str]) -> str:
    """Return the first option of these parameters."""
    return "--" + next(iter(names)).replace("_", "-")


_LABELS = {
    "plain": ("full size, Cycles' denoiser only", "none; render the file as it is, with *Denoise* on"),
    "temporal": ("full size, also denoised over time", "--denoise temporal"),
    "upscaled": ("half size, 4 times the samples, upscaled", "--scale 2 --samples {small}"),
}
"""Description of each way that `--advise` tries, and the options that choose it."""


def _advise(request: "RenderRequest", folder: Path, *, overwrite: bool, note: Callable[[str], None]) -> None:
    """Render a few frames each way, write one image for each, and print times and errors."""
    from supersampler.integrations.blender.advice import FRAMES, advise
    from supersampler.io.display import auto_exposure, to_uint8
    from supersampler.io.images import write_png

    advice = advise(request, folder, overwrite=overwrite, note=note)
    samples, transform = advice.scene.samples or 1, _transform_of(advice.scene, ["png"])
    echo(f"{'':<42}{'seconds':>9}{'error':>9}")
    exposure = auto_exposure(advice.ways[0].image)
    for way in advice.ways:
        shown = transform.show(way.image, exposure)
        write_png(folder / f"{way.name}.png", to_uint8(shown), transform.encoding)
        echo(f"{_LABELS[way.name][0]:<42}{way.seconds:>9.1f}{way.error:>9.1%}")
    name, (label, options) = advice.best.name, _LABELS[advice.best.name]
    others = [other for other in advice.alike if other != name]
    why = "the smallest error"
    if others:
        why = f"its error equals that of {', '.join(others)} within the noise, and it is not slower"
    echo(f"Recommended: {label}: {why}. Options: {options.format(small=4 * samples)}")
    echo(
        "Seconds: upper bound for a frame of full size, 4x the time of a frame with a quarter of its pixels. "
        f"Error: relative, in frame {advice.frame}, estimated from a render with other noise. Each way had "
        f"{FRAMES} frames; temporal denoising and upscaling improve with more. Flicker is not measured."
    )
    echo(f"Images: {folder}")


def _transform_of(scene: "RenderedScene", formats: list[str]) -> "DisplayTransform":
    """Return Blender's view transform of the scene; ShotError or ArgumentError if it is missing."""
    from supersampler.io.display_transforms import DEFAULT_TRANSFORM, ocio_transform

    if set(formats) == {"exr"}:  # needs no view transform; Blender's configuration may be missing
        return DEFAULT_TRANSFORM
    view = scene.view
    return ocio_transform(
        scene.ocio,
        view.display,
        view.view,
        look=view.look,
        color_space=scene.linear,
        stops=view.exposure,
        gamma=view.gamma,
    )
