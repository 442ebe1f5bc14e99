"""Call `Upscaler.step` from a renderer, frame by frame, as an engine does, and show input and output.

    python examples/live_renderer.py --family fences --ratio 2 --zoom 4 -o out/live

Copy the loop in `main` into your engine. Images are written, encoded as a video if ffmpeg is installed, and
shown if there is a display. Needs `pip install "supersampler[render]"`, but no GPU.
"""

import atexit
import shutil
import subprocess
import sys
from argparse import ArgumentDefaultsHelpFormatter, ArgumentParser, Namespace
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, SupersamplerError, Upscaler, halton_jitter
from supersampler.arguments import checked_scale
from supersampler.cli.arguments import parse_size
from supersampler.io.display import ExposureMeter, display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import (
    APART_FAMILIES,
    TEST_FAMILIES,
    TRAIN_FAMILIES,
    SequenceSpec,
    make_sequence,
)

Pixels = NDArray[np.uint8]


def main(options: Namespace) -> None:
    width, height = display_size = options.display_size
    ratio = checked_scale(options.ratio)
    render_size = (round(width / ratio), round(height / ratio))
    game = make_sequence(SequenceSpec(family=options.family, seed=options.seed, frames=options.frames))
    show = open_window(options.window)
    renderer = Renderer(display_size)
    upscaler = Upscaler(options.model, display_size=display_size)  # one per camera: it owns the history
    meter = ExposureMeter()  # for the images on screen; the upscaler has its own
    rendering, upscaling = [], []  # seconds of each frame

    for index in range(options.frames):
        began = perf_counter()
        scene = game.scene(index)  # objects, with their positions in the previous frame
        jitter = halton_jitter(index, ratio)  # samples are taken at pixel centre + jitter
        color, surfaces = renderer.frame(scene, render_size, jitter=jitter)
        frame = Frame(
            color=color,  # (h, w, 3) linear RGB, before tone mapping, not anti-aliased
            depth=surfaces.depth,  # (h, w) near / distance, 0 at the sky
            motion=surfaces.motion,  # (h, w, 2) render pixels, previous minus current, without jitter
            jitter=jitter,
            reset=game.cut(index),  # after a cut there is no history
            exposure=game.exposure(index),  # None: it is measured
        )
        rendered = perf_counter()
        image = upscaler.step(frame)  # (H, W, 3) linear RGB; bloom, tone mapping and the interface follow
        upscaling.append(perf_counter() - rendered)
        rendering.append(rendered - began)

        exposure = meter.read_frame(frame)
        pixels = side_by_side(color, image, exposure, options.zoom)
        write_png(options.output / f"{index:04d}.png", pixels)
        if show and not show(pixels):
            break

    print(f"{len(rendering)} images, {render_size} to {display_size}: {options.output}")
    print(f"rendering, with scene and read-back: {times(rendering)}")
    print(f"upscaling, {upscaler.model.info.method}: {times(upscaling)}")
    film(options.output, len(rendering), game.spec.frame_rate)


def side_by_side(color: NDArray[Any], image: NDArray[Any], exposure: float, zoom: int) -> Pixels:
    """Return input and output as displayed and, if `zoom` > 1, the middle of each below."""
    pair = [to_uint8(display_transform(part, exposure)) for part in (color, image)]
    rows = [[squares(part, image.shape[1::-1], by) for part in pair] for by in sorted({1, zoom})]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows])


def squares(pixels: Pixels, to: tuple[int, ...], zoom: int) -> Pixels:
    """Return the middle of an image, enlarged `zoom` times by nearest pixels, in the size `to`."""
    columns, rows = (
        (np.arange(n) // zoom + (n - n // zoom) // 2) * m // n
        for n, m in zip(to, pixels.shape[1::-1], strict=True)
    )
    return np.ascontiguousarray(pixels[rows[:, None], columns])


def open_window(when: str) -> Callable[[Pixels], bool] | None:
    """Return a function that shows an image and returns whether the window is open; None: no window."""
    if when == "never":
        return None
    try:
        import tkinter  # some Pythons lack it

        root = tkinter.Tk(className="supersampler")
    except Exception as error:  # no tkinter, or no display
        if when == "always":
            sys.exit(f"no window: {error}. --window never only writes files.")
        return None
    image, closed = tkinter.PhotoImage(master=root), []
    tkinter.Label(root, image=image).pack()
    atexit.register(root.destroy)  # before Python deletes objects that Tk uses
    root.protocol("WM_DELETE_WINDOW", lambda: closed.append(True))

    def show(pixels: Pixels) -> bool:
        image.configure(data=b"P6 %d %d 255\n" % pixels.shape[1::-1] + pixels.tobytes(), format="ppm")
        root.update()
        return not closed

    return show


def times(seconds: list[float]) -> str:
    """Return the time of the first frame, which includes allocation, and the median of the others."""
    rest = f", then {1000 * median(seconds[1:]):.1f} ms (median)" if seconds[1:] else ""
    return f"first frame {1000 * seconds[0]:.1f} ms{rest}"


def film(folder: Path, frames: int, frame_rate: float) -> None:
    """Encode the images as live.mp4, if ffmpeg is installed."""
    if shutil.which("ffmpeg"):
        source = f"-framerate {frame_rate} -i %04d.png -frames:v {frames}"
        coding = "-pix_fmt yuv420p -vf pad=ceil(iw/2)*2:ceil(ih/2)*2"  # some players need even sizes
        command = f"ffmpeg -v error -y {source} {coding} live.mp4".split()
        subprocess.run(command, cwd=folder, check=True)  # noqa: S603
        print(f"film: {folder / 'live.mp4'}")


def parse_arguments() -> Namespace:
    parser = ArgumentParser(formatter_class=ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add("--model", default="classifier", help="name of a model, or its folder")
    families = (*TRAIN_FAMILIES, *TEST_FAMILIES, *APART_FAMILIES)
    add("--family", default="fences", choices=families, help="family of scenes")
    add("--seed", type=int, default=0, help="seed of scene, camera, cuts and exposure")
    add("--frames", type=int, default=48, help="number of frames")
    add("--display-size", type=parse_size, default="640x360", metavar="WxH", help="size of the output")
    add("--ratio", type=float, default=2.0, help="display size over render size, 1 to 4")
    add("--zoom", type=int, default=1, choices=range(1, 17), help="also show the middle, enlarged")
    add("--window", choices=("auto", "always", "never"), default="auto", help="auto: if there is a display")
    add("-o", "--output", type=Path, default=Path("out/live"), help="folder for the images")
    return parser.parse_args()


if __name__ == "__main__":
    try:
        main(parse_arguments())
    except SupersamplerError as error:
        sys.exit(str(error))
