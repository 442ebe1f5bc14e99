"""CPU backend of `taa` (Salvi 2016), for its default options."""

from typing import NamedTuple

import numpy as np

from supersampler.backends.cpu.executor import CpuExecutor, Step
from supersampler.backends.cpu.history import HistoryLayout, Plane
from supersampler.backends.cpu.layout import LANES, PAD, TAA_BOX, TAA_PIXEL, TAA_PLANES, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import Columns, Filter, ResampleTableCache, linear, up_to
from supersampler.backends.cpu.structs import NO_MASK, Floats, Words, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.frame import Size
from supersampler.methods.constants import CATMULL_ROM
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.taa.spec import TAA


class TaaSamples(NamedTuple):
    """The samples of a frame, and the variance box of the 3x3 samples around each.

    Attributes:
        planes: (height, TAA_PLANES, PAD + stride + PAD) toned YCoCg, motion in render pixels.
        boxes: (height, TAA_BOX, stride) minimum and maximum YCoCg of the box, the longest motion.
        reactive, has_reactive: see `FrameInputs`.
        gamma: half extent of the box, in standard deviations.
        width, height: size of the frame.
        stride: width, rounded up to whole vectors.
    """

    planes: Floats
    boxes: Floats
    reactive: Floats
    has_reactive: int
    gamma: float
    width: int
    height: int
    stride: int


class LinearAxis(NamedTuple):
    """Linear interpolation of samples at the display pixels of one axis; arrays are (pixels,).

    Attributes:
        first, second: the samples before and after the pixel.
        first_weight, second_weight: their weights.
        nearest: the nearest sample.
    """

    first: Words
    second: Words
    first_weight: Floats
    second_weight: Floats
    nearest: Words


class TaaScratch(NamedTuple):
    """Scratch of one thread: offsets and weights of the warp, the warped history, the image's pixels."""

    slots: Words
    weights: Floats
    warped: Floats
    out: Floats


KERNELS = "methods.taa.kernels"
STEP, FILL, READ = f"{KERNELS}.step_rows", f"{KERNELS}.fill_boxes", f"{KERNELS}.read_samples"
LAYOUT = HistoryLayout(TAA, {"pixels": Plane(("color",), TAA_PIXEL)})


class _Space:
    """Buffers for frames of one size; `scratch` has one entry per thread."""

    def __init__(self, render: Size, display: Size, gamma: float, threads: int) -> None:
        w, h = render
        stride = up_to(w, LANES)
        self.tables = ResampleTableCache(render, display, [Filter(linear, False)], rows=Columns)
        planes, boxes = aligned((h, TAA_PLANES, stride + 2 * PAD)), aligned((h, TAA_BOX, stride))
        self.samples = TaaSamples(planes, boxes, NO_MASK, 0, gamma, w, h, stride)
        self.scratch = [
            TaaScratch(
                aligned((10, LANES), np.int32),
                aligned((10, LANES)),
                aligned((LANES, 4)),
                aligned((LANES, 16)),
            )
            for _ in range(threads)
        ]


class TaaCpu(CpuExecutor[_Space]):
    """Runs `taa`; see `Executor`.

    Args:
        info: the model.
        pool: the threads that run the kernels.
    """

    precision = "fp32"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        super().__init__(LAYOUT, pool, STEP, FILL, READ)
        self._alpha, self._gamma = info.config["alpha"], info.config["gamma"]

    def _space(self, render: Size, display: Size) -> _Space:
        return _Space(render, display, self._gamma, self.pool.threads)

    def _compute_tiles(self, step: Step, space: _Space) -> None:
        self._read(step, space)
        self._blend(step, space)

    def _read(self, step: Step, space: _Space) -> None:
        """Tone the samples, and compute the variance box around each."""
        mask, has_mask = step.inputs.reactive, step.inputs.has_reactive
        space.samples = space.samples._replace(reactive=mask, has_reactive=has_mask)
        inputs, samples, h = pack(step.inputs), pack(space.samples), space.samples.height
        read_samples, fill_boxes = self.kernels[READ], self.kernels[FILL]

        def read(y0: int, y1: int, _: int) -> None:
            # one more row on either side instead of waiting; two threads write the same values there
            read_samples(inputs, samples, max(y0 - 1, 0), min(y1 + 1, h))
            fill_boxes(samples, y0, y1)

        self.pool.run_rows("preprocess", h, read)

    def _blend(self, step: Step, space: _Space) -> None:
        """Compute the image, which is the next history."""
        history = step.history
        alpha = self._alpha if abs(history.exposure) > 0.0 else 1.0
        numbers = np.array([step.inputs.exposure, alpha, CATMULL_ROM], np.float32)
        columns, rows = (  # a tent has weight only at the inner two of the four samples around a pixel
            pack(LinearAxis(axis.samples[1], axis.samples[2], axis.weights[1], axis.weights[2], axis.near))
            for axis in space.tables.at(step.frame.jitter)
        )
        inputs = pack(space.samples), address(history.arrays["pixels"]), columns, rows, address(numbers)
        kernel, output, scratch = self.kernels[STEP], pack(step.output), [pack(s) for s in space.scratch]

        def compute(box: Rect, worker: int) -> None:
            kernel(*inputs, scratch[worker], output, *box)

        self.pool.run_rects("compute", step.tiles.boxes(TILE, step.display), compute)
