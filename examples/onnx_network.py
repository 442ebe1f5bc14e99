"""Step a shot with the network in ONNX Runtime, on any provider, and CPU kernels before and after it.

    python examples/onnx_network.py [SHOT] [--providers openvino] [--precision int8] [--frames 16] [-o OUT]

Prints the time of each step, and the difference of its image from that of the CPU backend, whose kernels also
run the network. With -o, writes the images as PNG. docs/contract.md describes the inputs and outputs of
network.onnx and network.int8.onnx, for engines whose own shaders do what the kernels do here.
"""

import itertools
import sys
import time
from argparse import ArgumentDefaultsHelpFormatter, ArgumentParser, Namespace
from pathlib import Path

import numpy as np

from supersampler import Shot, Upscaler
from supersampler.errors import SupersamplerError
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png


def main(options: Namespace) -> None:
    """Step the frames of a shot on both backends."""
    shot, providers = Shot.open(options.shot), options.providers.split(",")
    size = shot.display_size
    backend = {"executor": "cpu+onnx", "providers": providers, "precision": options.precision}
    upscaler = Upscaler(options.model, display_size=size, **backend)
    kernels = Upscaler(options.model, display_size=size, executor="cpu", providers="cpu")
    print(f"{options.model}: network in {upscaler.model.precision} on {upscaler.model.providers[0]}")
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    for item in itertools.islice(shot, options.frames):
        began = time.perf_counter()
        image = upscaler.step(item.frame)
        milliseconds = 1e3 * (time.perf_counter() - began)
        exposure = item.frame.exposure or 1.0
        shown, other = (display_transform(i, exposure) for i in (image, kernels.step(item.frame)))
        difference = float(np.abs(shown - other).mean())
        print(f"frame {item.index}: {milliseconds:.1f} ms, mean difference {difference:.5f} of 1")
        if options.output is not None:
            write_png(options.output / f"{item.index:04d}.png", to_uint8(shown))


def parse_arguments() -> Namespace:
    parser = ArgumentParser(formatter_class=ArgumentDefaultsHelpFormatter)
    add = parser.add_argument
    add("shot", nargs="?", default="plaza", help="name of a shot, or its folder")
    add("--model", default="classifier", help="name of a classifier, or a model folder")
    add("--providers", default="cpu", help="of ONNX Runtime, in order of preference: cuda,cpu")
    add("--precision", default="int8", choices=("fp32", "int8"), help="precision of the network")
    add("--frames", type=int, default=16, help="number of frames")
    add("-o", "--output", type=Path, help="folder for the images")
    return parser.parse_args()


if __name__ == "__main__":
    try:
        main(parse_arguments())
    except SupersamplerError as error:
        sys.exit(str(error))
