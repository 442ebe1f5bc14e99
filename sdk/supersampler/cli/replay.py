"""`supersampler replay`: repeats a recording and compares the images."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer

from supersampler.arguments import ExecutorName, Precision
from supersampler.cli.arguments import ImageFormat, folder_path, parse_providers, size_text
from supersampler.cli.terminal import Terminal, echo, frame_warnings
from supersampler.errors import ShotError

if TYPE_CHECKING:
    from supersampler.recording import Setup
    from supersampler.recording.replay import Replay, Replayed


def replay(
    recording: Annotated[Path, typer.Argument(metavar="FOLDER", help="A recording.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FOLDER", parser=folder_path, help="New folder to write the images to."
        ),
    ] = None,
    format: Annotated[  # noqa: A002  # the option's name
        list[ImageFormat] | None, typer.Option(help="See `supersampler upscale`.", show_default="exr")
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="A model folder, or a shipped model by name.", show_default="recorded")
    ] = None,
    extrapolate: Annotated[
        str | None,
        typer.Option(
            help="A model folder, or a shipped model by name, for unshaded frames.", show_default="recorded"
        ),
    ] = None,
    executor: Annotated[
        ExecutorName | None, typer.Option(help="The backend: onnx, cpu or gpu.", show_default="recorded")
    ] = None,
    precision: Annotated[
        Precision | None, typer.Option(help="Precision of the network.", show_default="recorded")
    ] = None,
    providers: Annotated[
        str | None,
        typer.Option(
            help="ONNX Runtime providers, as for `supersampler upscale`.", show_default="recorded, or auto"
        ),
    ] = None,
) -> None:
    """Replay a recording of `upscale --record FOLDER` or `Upscaler(record=FOLDER)`, and compare the images.

    Prints the number of bit-identical frames, the first frame that differs, and the largest difference. The
    exit code is 1 if a frame is beyond tolerance, or is refused in only one of the two runs.

    \b
    Examples:
      supersampler replay kitchen.recording
      supersampler replay kitchen.recording -o out --format png --executor onnx
    """  # noqa: D301  # \b: click keeps the line breaks
    from supersampler.cli.results import ImageOptions, OutputImage
    from supersampler.io.files import check_apart, is_there
    from supersampler.recording import open_recording
    from supersampler.recording.replay import Replay

    replay = Replay(
        open_recording(recording),
        model=model,
        extrapolation=extrapolate,
        executor=executor,
        precision=precision,
        providers=None if providers is None else parse_providers(providers),
    )
    images = ImageOptions(formats=[str(item) for item in format or [ImageFormat.exr]])
    if output is not None:
        check_apart(output, recording)
        if is_there(output):
            raise ShotError(output, "already exists", "Choose another name, or move it away.")
    steps: list[Replayed] = []
    _print_machines(replay)
    try:
        for step in _repeat(replay, steps):
            if output is not None and step.result is not None:
                result = step.result
                image = OutputImage(image=result.image, exposure=step.exposure, aovs=result.aovs)
                images.write(output, step.index, image)
    finally:  # also if a damaged file ends the replay
        for line in _verdict(replay, steps):
            echo(line)
    if not all(step.within for step in steps):
        raise typer.Exit(1)


def _print_machines(replay: "Replay") -> None:
    """Print the recording's method and size, the recorded machine, and this machine."""
    from supersampler.io.machine import machine, versions

    setup, model = replay.recording.setup, replay.model
    size = f"to {size_text(setup.display_size)}" if setup.display_size else f"{setup.scale:g} times"
    here = msgspec.structs.replace(
        setup, executor=model.executor, precision=model.precision, providers=tuple(model.providers),
        versions=versions(), machine=machine(),
    )  # fmt: skip
    echo(f"{replay.recording.path}: {setup.method}, {size}")
    echo(f"  recorded  {_machine(setup)}")
    echo(f"  here      {_machine(here)}")


def _machine(setup: "Setup") -> str:
    provider = setup.providers[0].removesuffix("ExecutionProvider") if setup.providers else "unknown"
    packages = ", ".join(f"{name} {version}" for name, version in setup.versions.items())
    where = f"{setup.machine.get('cpu')}, {setup.machine.get('cores')} cores, {setup.machine.get('os')}"
    return f"{provider} ({setup.executor}, {setup.precision}); {packages}; {where}"


def _repeat(replay: "Replay", steps: "list[Replayed]") -> "Iterator[Replayed]":
    """Repeat all calls, print their outcomes, append them without images to `steps`, and yield them."""
    from supersampler.recording import CloseCall, StepCall

    console, call = Terminal(stderr=True), None
    for call in replay.recording:
        if isinstance(call, StepCall) and call.outcome is None:  # print first: it may crash this process, too
            echo(f"frame {call.index}: its outcome was not recorded")
        with frame_warnings(console, len(steps)):
            step = replay.call(call)
        if step is None:
            continue
        steps.append(replace(step, result=None))
        if step.note:
            echo(f"frame {step.index}: {step.note}")
        yield step
    if not isinstance(call, CloseCall):
        echo("The recording was not closed; it ends with its last complete call.")


def _verdict(replay: "Replay", steps: "list[Replayed]") -> Iterator[str]:
    """Yield lines that state how many images differ, from which frame on, and by how much."""
    if not replay.is_recorded_model:
        yield "The model is not the recorded one, so the images differ."
    known = [step for step in steps if step.exact is not None]
    differ = [step for step in known if not step.exact]
    same = f"{len(known) - len(differ)} of {len(known)} frames are bit-identical to the recorded ones"
    if not differ:
        yield f"{same}."
        return
    yield f"{same}; frame {differ[0].index} is the first that differs."
    found = {step.index: step.difference for step in differ if step.difference is not None}
    if found:
        frame = max(found, key=lambda index: found[index].max)
        mean, p99 = (max(getattr(each, name) for each in found.values()) for name in ("mean", "p99"))
        yield (
            f"Largest difference: {found[frame].max:.2g} of the display range, in frame {frame}; "
            f"mean up to {mean:.2g}, 99th percentile up to {p99:.2g}."
        )
    limits = f"mean {replay.tolerance.mean:.2g}, 99th percentile {replay.tolerance.p99:.2g}"
    beyond = [step.index for step in differ if not step.within]
    if beyond:
        yield f"Frame {beyond[0]} is the first beyond tolerance: {limits}."
    else:
        yield f"All differences are within tolerance: {limits}."
