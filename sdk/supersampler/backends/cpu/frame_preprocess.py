"""Frame preprocessing: exposure, toned samples, sanitized depth and motion, resampling tables."""

import math
from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.at_rest import blocks_at, windowed
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import FILTER_LINES, LANES, PAD, SAMPLE_PLANES
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import Filter, Kernel, ResampleTableCache, up_to
from supersampler.backends.cpu.structs import NO_MASK, FrameInputs, FrameSamples, Output, ResampleTables, pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import EXPOSURE_KEY, MAX_HALF, followed_exposure, usable_exposure
from supersampler.methods.constants import FILL_WINDOW, GREY_SHARE

_KERNELS = "backends.cpu.kernels.frame"
MEASURE = f"{_KERNELS}.measure"
READ_KERNELS = (f"{_KERNELS}.prepare", f"{_KERNELS}.dilate")
"""Kernels of `FramePreprocess.read`."""


def frame_inputs(frame: Frame) -> FrameInputs:
    """Return the arrays of a frame as C-contiguous float32, converted where needed.

    The colour is without pre-exposure. A reactive mask of zeros counts as none.
    """
    color, depth, motion = (
        np.ascontiguousarray(a, np.float32) for a in (frame.color, frame.depth, frame.motion)
    )
    if frame.pre_exposure != 1.0:
        color = color / np.float32(frame.pre_exposure)
    if frame.reactive is None or not frame.reactive.any():
        return FrameInputs(color, depth, motion)
    mask = np.where(np.isnan(color).any(axis=2), np.float32(0.0), frame.reactive).astype(np.float32)
    return FrameInputs(color, depth, motion, mask, 1)


def with_exposure(inputs: FrameInputs, exposure: float) -> FrameInputs:
    """Return the arrays with the exposure to use, and what fills missing samples."""
    fill = missing_fill(inputs.color, exposure)
    if fill is None:
        return inputs._replace(exposure=exposure)
    return inputs._replace(exposure=exposure, fill=fill, fill_across=fill.shape[1])


def missing_fill(color: Float32, exposure: float) -> Float32 | None:
    """Return the linear RGB of missing samples by window, (down, across, 3); None where none is missing.

    Same as `supersampler_model.ops.color.filled`.
    """
    if not np.isnan(color.min()):
        return None
    usable = ~np.isnan(color).any(axis=2, keepdims=True)
    roots = np.sqrt(np.where(usable, np.clip(color, 0.0, MAX_HALF), np.float32(0.0)))
    sums = windowed(np.concatenate([roots, usable], axis=2).transpose(2, 0, 1), FILL_WINDOW)
    means = sums / np.float32(FILL_WINDOW * FILL_WINDOW)
    grey = np.sqrt(np.float32(EXPOSURE_KEY / exposure))
    fill: Float32 = np.square((means[:3] + GREY_SHARE * grey) / (means[3] + GREY_SHARE))
    return np.ascontiguousarray(fill.transpose(1, 2, 0), np.float32)


def empty_samples(render: Size) -> FrameSamples:
    """Allocate buffers for the samples of a frame."""
    w, h = render
    stride = up_to(w, LANES)
    padded_width = stride + 2 * PAD
    depth, motion_x, motion_y, eroded_depth = aligned((4, h, padded_width))
    dilated, own = aligned((2, h, stride, 4))
    color, glares, still_rows = aligned((h, SAMPLE_PLANES, padded_width)), aligned((h,)), aligned((h,))
    return FrameSamples(
        color, depth, motion_x, motion_y, eroded_depth, dilated, own, glares, still_rows, NO_MASK, 0,
        NO_MASK, 0, w, h, stride,
    )  # fmt: skip


class ResampledFrame:
    """The samples of a frame, and the tables for resampling them.

    Args:
        render, display: sizes.
        filters, windows: see `Axis`.
        threads: number of threads.

    Attributes:
        tables: tables of all jitters.
        x, y: tables of columns and rows for the current jitter.
        samples: samples of the current frame.
        padded_width: samples of a row, its padding included.
        lines: (threads, ...) FILTER_LINES + 4 lines of filtered samples per thread.
    """

    def __init__(
        self,
        render: Size,
        display: Size,
        filters: Sequence[Filter],
        threads: int,
        windows: Sequence[Kernel] = (),
    ) -> None:
        self.tables = ResampleTableCache(render, display, filters, windows)
        self.set_jitter((0.0, 0.0))
        self.samples = empty_samples(render)
        self.padded_width = self.samples.stride + 2 * PAD
        self.lines = aligned((threads, (FILTER_LINES + 4) * self.padded_width + LANES))

    def set_jitter(self, jitter: tuple[float, float]) -> None:
        """Set the jitter of the current frame."""
        self.x, self.y = self.tables.at(jitter)

    def set_masks(self, inputs: FrameInputs) -> None:
        """Set the reactive mask of the current frame, and what fills its missing samples."""
        fill = NO_MASK, 0
        if inputs.fill_across:
            toned = inputs.fill * np.float32(inputs.exposure)
            toned = (toned / (1.0 + toned.max(axis=2, keepdims=True))).transpose(0, 2, 1)
            pitch = up_to(len(self.x.near), LANES)
            across = aligned((len(toned), 3, pitch))
            across[..., : len(self.x.near)] = toned[..., self.x.near // FILL_WINDOW]
            fill = across, pitch
        self.samples = self.samples._replace(
            reactive=inputs.reactive, has_reactive=inputs.has_reactive, fill=fill[0], fill_pitch=fill[1]
        )

    def current_tables(self) -> ResampleTables:
        """Return the tables for the current jitter."""
        x, y = self.x, self.y
        return ResampleTables(
            y.samples, y.weights, y.windows, y.first, y.near, x.start, x.weights, x.windows, x.first, x.near
        )


class AuxOutputs:
    """The auxiliary outputs: weight of the history, and where the image is frozen.

    Args:
        names: of the requested outputs; others than these two are ignored.
        display: size of the image.

    Attributes:
        planes: (1, 1, H, pitch) each, by name; rows are padded to whole vectors.
    """

    def __init__(self, names: Collection[str], display: Size) -> None:
        self._display, self._width = display, display[0]
        shape = (1, 1, display[1], up_to(display[0], LANES))
        own = [name for name in ("weight", "converged") if name in names]
        self.planes = {name: np.zeros(shape, np.float32) for name in own}

    def output(self, next_history: Float32, image: Float32) -> Output:
        """Return the outputs of a step."""
        height, width = image.shape[:2]
        rows = self.planes.get("weight", np.zeros(1, np.float32))
        has_weight = int("weight" in self.planes)
        return Output(next_history, image, rows, has_weight, width, height, up_to(width, LANES))

    def fill(self, name: str, blocks: NDArray[np.bool_], render: Size) -> None:
        """Write 1 at the pixels of these blocks, if the output is requested."""
        if name in self.planes:
            at = blocks_at(self._display, render)
            self.planes[name][0, 0, :, : self._width] = blocks[at.rows][:, at.columns]

    def results(self) -> dict[str, Float32]:
        """Return the requested outputs, (1, 1, H, W) each."""
        return {name: plane[..., : self._width] for name, plane in self.planes.items()}


class FramePreprocess:
    """The first stage of all methods except `taa`, which uses only its exposure.

    Args:
        kernels: kernels by name: MEASURE, and READ_KERNELS for `read`.
        pool: the threads that run them.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool, self._kernels = pool, kernels
        self._measure = kernels[MEASURE]

    def exposure(self, frame: Frame, color: Float32, before: float) -> float:
        """Return the frame's exposure, given or measured; see `followed_exposure`."""
        given = usable_exposure(frame.exposure)
        target = self._measured(color) if given is None else None
        return float(np.float32(followed_exposure(given, target, before)))

    def _measured(self, color: Float32) -> float | None:
        """Return EXPOSURE_KEY over the log-average luminance; None if no pixel is usable."""
        h, w = color.shape[:2]
        rows = np.zeros((h, 2), np.float32)
        self._pool.run_rows(
            "preprocess", h, lambda y0, y1, _: self._measure(address(color), w, y0, y1, address(rows))
        )
        logs, count = (float(total) for total in rows.sum(axis=0, dtype=float))
        return EXPOSURE_KEY * math.exp(-logs / count) if count else None

    def read(self, frame: FrameInputs, samples: FrameSamples) -> None:
        """Fill `samples` from a frame."""
        inputs, output = pack(frame), pack(samples)
        prepare, dilate = (self._kernels[name] for name in READ_KERNELS)

        def read(y0: int, y1: int, _: int) -> None:
            # one more row on either side instead of waiting; two threads write the same values there
            prepare(inputs, output, max(y0 - 1, 0), min(y1 + 1, samples.height))
            dilate(output, y0, y1)

        self._pool.run_rows("preprocess", samples.height, read)
