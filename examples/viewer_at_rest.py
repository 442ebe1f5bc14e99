"""Render in a viewer only until the image has converged.

    python examples/viewer_at_rest.py -o out/at_rest.png

The camera pans over a poster, stands still, and pans on. Copy `is_final` and the loop in `main`. The renderer
is a few lines of numpy; no display is needed.
"""

import sys
from argparse import ArgumentDefaultsHelpFormatter, ArgumentParser, Namespace
from pathlib import Path

import numpy as np

from supersampler import Frame, SupersamplerError, Upscaler, halton_jitter
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png

RENDER, RATIO = (160, 90), 2.0
DISPLAY = (320, 180)
SPEED = 0.7  # of the moving camera, render pixels per frame
PAN, STAND = 24, 160  # frames of each pan, and of the rest between the two


def main(options: Namespace) -> None:
    upscaler = Upscaler(options.model, display_size=DISPLAY, executor=options.executor)
    camera, rendered = 0.0, 0
    for index in range(PAN + STAND + PAN):
        speed = 0.0 if PAN <= index < PAN + STAND else SPEED
        if speed == 0.0 and is_final(upscaler):
            continue  # the image on screen is final: sleep until something changes
        camera += speed
        image = upscaler.step(render(camera, speed, rendered))
        rendered += 1
        if speed == 0.0 and is_final(upscaler):
            write_png(options.output, to_uint8(display_transform(image)))
            print(f"frame {index}: converged, {index - PAN + 1} frames after the stop: {options.output}")
    print(f"rendered {rendered} of {PAN + STAND + PAN} frames")


def is_final(upscaler: Upscaler) -> bool:
    """Return whether another frame of the same scene would leave the image unchanged."""
    return (upscaler.stats.converged or 0.0) >= 0.99  # not 1: a few blocks are never frozen


def render(camera: float, speed: float, index: int) -> Frame:
    """Sample a poster of rings and stripes once per pixel.

    Args:
        camera: position of the camera, render pixels to the right.
        speed: motion since the previous frame, render pixels.
        index: index of the rendered frame, for the jitter, which continues at rest.
    """
    width, height = RENDER
    jitter = halton_jitter(index, RATIO)
    x = np.arange(width) + 0.5 + jitter[0] + camera
    y = (np.arange(height) + 0.5 + jitter[1])[:, None]
    rings = 0.5 + 0.4 * np.cos(0.02 * ((x - 90.0) ** 2 + (y - 45.0) ** 2))
    stripes = (np.floor(0.55 * x + 0.31 * y) % 2) * 0.8
    level = np.where(y < 60.0, rings, stripes).astype(np.float32)
    motion = np.zeros((height, width, 2), np.float32)
    motion[..., 0] = speed  # previous minus current: the poster moves to the left
    return Frame(
        color=level[..., None] * np.array([1.0, 0.9, 0.7], np.float32),
        depth=np.full((height, width), 0.1, np.float32),
        motion=motion,
        jitter=jitter,
        reset=index == 0,
        exposure=1.0,
    )


def parse_arguments() -> Namespace:
    parser = ArgumentParser(formatter_class=ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add("--model", default="classifier", help="name of a model, or its folder")
    add("--executor", default="auto", choices=("auto", "cpu", "onnx"), help="backend")
    add("-o", "--output", type=Path, default=Path("out/at_rest.png"), help="the converged image")
    return parser.parse_args()


if __name__ == "__main__":
    try:
        main(parse_arguments())
    except SupersamplerError as error:
        sys.exit(str(error))
