"""Panda3D renders at half size, with OpenGL in software, and each frame is upscaled.

    pip install . panda3d
    python examples/panda3d_live.py --frames 48 -o out/panda

A camera flies around a panda in a landscape; both come with Panda3D. Only the camera moves, so
`camera_motion` computes the motion of every pixel. Writes images: the enlarged render beside the output.
"""

import argparse
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from direct.showbase.ShowBase import ShowBase
from panda3d.core import (
    FrameBufferProperties,
    GraphicsOutput,
    GraphicsPipe,
    GraphicsPipeSelection,
    PerspectiveLens,
    SamplerState,
    Texture,
    WindowProperties,
    loadPrcFileData,
)

from supersampler import Conventions, Frame, RawFrame, Upscaler
from supersampler.cli.arguments import parse_size
from supersampler.conventions import camera_motion, halton_jitter, mip_bias
from supersampler.conventions.encodings import srgb_encoded
from supersampler.io.display import to_uint8
from supersampler.io.images import write_png

SCALE = 2
CONVENTIONS = Conventions(depth="forward", near=1.0, far=500.0, srgb=True)


def main() -> None:
    """Render and upscale the sequence."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--display-size", type=parse_size, default=(960, 540), help="such as 960x540")
    parser.add_argument("--model", default="classifier", help="name of a model, or its folder")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/panda"), help="folder for the images")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    width, height = options.display_size
    renderer = Renderer((width // SCALE, height // SCALE))
    upscaler = Upscaler(options.model, display_size=(width, height), render_size=renderer.size)
    rendering, upscaling = [], []
    for index in range(options.frames):
        began = perf_counter()
        frame = renderer.frame(index)
        rendered = perf_counter()
        image = upscaler.step(frame)
        upscaling.append(perf_counter() - rendered)
        rendering.append(rendered - began)
        squares = np.asarray(frame.color).repeat(SCALE, axis=0).repeat(SCALE, axis=1)
        both = np.concatenate([squares, image], axis=1)
        write_png(options.output / f"{index:04d}.png", to_uint8(srgb_encoded(np.clip(both, 0.0, 1.0))))
    print(f"{options.frames} images: {options.output}")
    print(
        f"rendering {1000 * median(rendering):.1f} ms, upscaling {1000 * median(upscaling):.1f} ms (medians)"
    )


class Renderer:
    """An off-screen buffer of Panda3D, whose colour and depth are read back. Frames are rendered in order.

    Args:
        size: (width, height) of the render.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        loadPrcFileData("", "window-type none\naudio-library-name null\nnotify-level-device fatal")
        self.size, self.base = size, ShowBase()
        self.lens = PerspectiveLens()
        self.lens.setNearFar(CONVENTIONS.near, CONVENTIONS.far)
        self.lens.setFilmSize(16.0, 16.0 * size[1] / size[0])
        self.lens.setFov(50.0)
        self._buffer = self._open()
        self._color, self._depth = Texture("color"), Texture("depth")
        self._depth.setFormat(Texture.FDepthComponent32)
        self._depth.setComponentType(Texture.TFloat)
        self._buffer.addRenderTexture(self._color, GraphicsOutput.RTMCopyRam, GraphicsOutput.RTPColor)
        self._buffer.addRenderTexture(self._depth, GraphicsOutput.RTMCopyRam, GraphicsOutput.RTPDepth)
        self.camera = self.base.makeCamera(self._buffer, lens=self.lens)
        self._buffer.setClearColor((0.5, 0.7, 0.9, 1.0))
        for name, scale in (("environment", 0.25), ("panda", 1.0)):
            model = self.base.loader.loadModel(f"models/{name}")
            model.setScale(scale)
            model.reparentTo(self.base.render)
            if name == "environment":
                model.setPos(-8, 42, 0)
        for texture in self.base.render.findAllTextures():  # mip levels of the display size
            sampler = SamplerState(texture.getDefaultSampler())
            sampler.setMinfilter(SamplerState.FTLinearMipmapLinear)
            sampler.setLodBias(mip_bias(SCALE, "log2"))
            texture.setDefaultSampler(sampler)
        self._previous: np.ndarray | None = None

    def _open(self) -> Any:
        pipe = GraphicsPipeSelection.getGlobalPtr().makeModulePipe("p3headlessgl")
        if pipe is None:
            raise SystemExit("no OpenGL without a window: Panda3D has no p3headlessgl here")
        properties = FrameBufferProperties()
        properties.setRgbaBits(8, 8, 8, 8)
        properties.setDepthBits(32)
        window = WindowProperties.size(*self.size)
        return self.base.graphicsEngine.makeOutput(
            pipe, "small", 0, properties, window, GraphicsPipe.BFRefuseWindow
        )

    def view_projection(self) -> np.ndarray:
        """Return projection @ view of the lens; Panda3D's matrices act on row vectors."""
        view = self.base.render.getTransform(self.camera).getMat()
        return rows_of(view * self.lens.getProjectionMat()).T

    def shift(self, jitter: tuple[float, float]) -> None:
        """Move the samples by a jitter in pixels, by moving the film, whose y points up."""
        film, (width, height) = self.lens.getFilmSize(), self.size
        self.lens.setFilmOffset(jitter[0] * film[0] / width, -jitter[1] * film[1] / height)

    def frame(self, index: int) -> Frame:
        """Render a frame of the flight."""
        angle = np.radians(1.5 * index)
        self.camera.setPos(float(30 * np.sin(angle)), float(-30 * np.cos(angle)), 9.0)
        self.camera.lookAt(0.0, 0.0, 5.0)
        matrix, jitter = self.view_projection(), halton_jitter(index, SCALE)
        self.shift(jitter)
        self.base.graphicsEngine.renderFrame()
        self.lens.setFilmOffset(0.0, 0.0)
        width, height = self.size
        # Row 0 is the bottom one, and channels are BGRA.
        color = np.frombuffer(self._color.getRamImage(), np.uint8).reshape(height, width, -1)[::-1, :, 2::-1]
        depth = np.frombuffer(self._depth.getRamImage(), np.float32).reshape(height, width)[::-1]
        previous = matrix if self._previous is None else self._previous
        motion = camera_motion(depth, matrix, previous, jitter=jitter, clip="minus_one_to_one")
        raw = RawFrame(
            color=color.astype(np.float32) / 255.0,
            depth=depth,
            motion=motion,
            jitter=jitter,
            reset=self._previous is None,
            exposure=1.0,
        )
        self._previous = matrix
        return CONVENTIONS.converter().to_frame(raw)


def rows_of(matrix: Any) -> np.ndarray:
    """Return a matrix of Panda3D as an array."""
    return np.array([[matrix.getCell(row, column) for column in range(4)] for row in range(4)])


if __name__ == "__main__":
    main()
