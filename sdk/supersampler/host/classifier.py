"""`classifier` on a processor: gather, network in bytes and finish, row by row on several threads."""

import threading
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size
from supersampler.host.bands import Bands
from supersampler.host.compiler import address, load_kernel
from supersampler.host.exposure import exposure_of
from supersampler.host.network import ALIGNED, ByteNetwork, Encoder
from supersampler.host.tables import Axis, Filter, catmull_rom, gaussian
from supersampler.model_info import ModelInfo

LANES, PAD = 16, 16
SEEN, WHOLE, HALVES, MIXING = 18, 9, 17, 96  # see kernels.classifier_seen, _gather, _finish
PIXEL = 8  # values of a pixel that go from frame to frame: colour, count, range, and two of room


@dataclass(eq=False)
class ClassifierHistory:
    """What one frame leaves for the next.

    Attributes:
        pixels: (H, W, PIXEL) linear RGB, count, least and most luma.
        classes: (H / 2, W / 2, 8) shares of six classes, 255 is all.
        surfaces: (2, h, stride) depth as it is and without thin things.
        render: size of that frame.
        jitter: of that frame.
        exposure: of that frame; 0 where there is none.
    """

    pixels: Float32
    classes: NDArray[np.uint8]
    surfaces: Float32
    render: Size
    jitter: tuple[float, float]
    exposure: float


class _Workspace:
    """Buffers for frames of one size; not for two steps at once."""

    def __init__(self, host: "ClassifierHost", render: Size, display: Size) -> None:
        c, bands = host.config, host.bands
        (w, h), (big_w, big_h) = render, display
        half = self.half = (big_w + 1) // 2, (big_h + 1) // 2
        stride, width = up_to(w, LANES), up_to(big_w, LANES)
        self.stride, self.width, self.half_stride = stride, width, up_to(half[0], LANES) + 2 * PAD
        filters = [
            Filter(gaussian(c["sample_sigma"]), True, 4),
            Filter(catmull_rom, False, 4),
            Filter(gaussian(c["moment_sigma"]), False, 7),
        ]
        window = gaussian(c["kernel_sigma"])
        self.x = Axis(big_w, w, filters, window, rows=False)
        self.y = Axis(big_h, h, filters, window, rows=True)
        self.samples = np.zeros((h, stride, LANES), np.float32)
        self.depths, self.across, self.down, self.eroded = np.zeros((4, h, stride + 2 * PAD), np.float32)
        self.nearest, self.edges = np.zeros((h, 3, stride), np.float32), np.zeros((h, stride), np.float32)
        self.whole = np.zeros((big_h, WHOLE, width), np.float32)
        self.halves = np.zeros((big_h, HALVES, width), np.uint16)
        self.means = np.zeros((half[1], 2, self.half_stride), np.float32)
        self.encoder = Encoder(host.network, half, bands)
        self.scratch = [_Scratch(self, host.network) for _ in range(bands.threads)]


class _Scratch:
    """Rows that one thread works on."""

    def __init__(self, space: _Workspace, network: ByteNetwork) -> None:
        width, half_w = space.width, space.half[0] + LANES
        self.line = np.zeros((space.stride, LANES), np.float32)
        self.filtered = np.zeros((width, LANES), np.float32)
        self.ring = np.zeros((3, width + 2 * PAD), np.float32)
        self.slots, self.weights = np.zeros((12, LANES), np.int32), np.zeros((12, LANES), np.float32)
        self.warped = np.zeros((LANES, LANES), np.float32)
        self.followed, self.apart = np.zeros(2 * width, np.float32), np.zeros(4 * width + 2 * LANES, np.float32)
        self.seen = np.zeros(4 * SEEN * width + 2 * LANES, np.uint8)
        self.tall, self.tent = np.zeros((2, space.half_stride), np.float32)
        self.read = np.zeros((half_w, 32), np.uint8)
        self.hidden = np.zeros((half_w, network.hidden.outputs), np.uint8)
        self.mixing = np.zeros((half_w, MIXING), np.float32)
        self.near, self.factors = np.zeros(LANES, np.int32), np.zeros((9, LANES), np.float32)
        self.out = np.zeros((LANES, LANES), np.float32)


class ClassifierHost:
    """Steps frames; several threads may, each with histories of its own.

    Args:
        info: of the model.
        bands: threads.
    """

    def __init__(self, info: ModelInfo, bands: Bands) -> None:
        self.config: Mapping[str, Any] = info.config
        self.bands = bands
        self.network = ByteNetwork(info.folder / "network.npz")
        self._measure, self._prepare, self._closest, self._surfaces = (
            load_kernel("frame", name) for name in ("measure", "prepare", "closest", "surfaces")
        )
        self._gather = load_kernel("classifier_gather", "gather_rows")
        self._around = load_kernel("classifier_seen", "around")
        self._finish = load_kernel("classifier_finish", "finish_rows")
        self._lock = threading.Lock()
        self._spaces: dict[tuple[Size, Size], list[_Workspace]] = {}

    def zeros(self, display: Size, render: Size) -> ClassifierHistory:
        """No past."""
        (w, h), (big_w, big_h) = render, display
        return ClassifierHistory(
            np.zeros((big_h, big_w, PIXEL), np.float32),
            np.zeros(((big_h + 1) // 2, (big_w + 1) // 2, 8), np.uint8),
            np.zeros((2, h, up_to(w, LANES)), np.float32),
            render,
            (0.0, 0.0),
            0.0,
        )

    def step(
        self,
        frame: Frame,
        display: Size,
        history: ClassifierHistory,
        left: ClassifierHistory,
        image: Float32,
        weight: Float32 | None = None,
    ) -> None:
        """Upscale one frame.

        Args:
            frame: checked.
            display: (W, H).
            history: what the frame before left.
            left: of the same size as `zeros` for this frame; written to.
            image: (H, W, 3), written to.
            weight: (H, up_to(W, LANES)) share of the past, written to.
        """
        space = self._take(frame.size, display)
        try:
            self._step(space, _planes(frame), frame, history, left, image, weight)
        finally:
            self._give(space, frame.size, display)

    def _step(
        self,
        space: _Workspace,
        planes: tuple[Float32, Float32, Float32],
        frame: Frame,
        history: ClassifierHistory,
        left: ClassifierHistory,
        image: Float32,
        weight: Float32 | None,
    ) -> None:
        exposure = frame.exposure or self._measured(planes[0], history.exposure)
        left.render, left.jitter, left.exposure = frame.size, frame.jitter, float(np.float32(exposure))
        space.x.look(frame.jitter[0])
        space.y.look(frame.jitter[1])
        self._read(space, planes, left.exposure)
        self._gather_all(space, history, left)
        self._enter(space)
        space.encoder.run()
        self._compose(space, left, image, weight)

    def _measured(self, color: Float32, before: float) -> float:
        h, w = color.shape[:2]
        rows = np.zeros((h, 2), np.float32)
        self.bands.run(h, lambda y0, y1, _: self._measure(address(color), w, y0, y1, address(rows)))
        return exposure_of(rows, before)

    def _read(self, space: _Workspace, planes: tuple[Float32, Float32, Float32], exposure: float) -> None:
        """Tone the samples; find what is in front."""
        s, (h, w) = space, planes[1].shape
        inputs = [address(plane) for plane in planes]
        to = [address(plane) for plane in (s.samples, s.depths, s.across, s.down)]
        self.bands.run(h, lambda y0, y1, _: self._prepare(*inputs, exposure, w, s.stride, y0, y1, *to))
        found = [address(plane) for plane in (s.nearest, s.edges, s.eroded)]
        self.bands.run(h, lambda y0, y1, _: self._closest(*to[1:], w, h, s.stride, y0, y1, *found))

    def _gather_all(self, space: _Workspace, history: ClassifierHistory, left: ClassifierHistory) -> None:
        s, c = space, self.config
        (old_w, old_h), (w, h), (big_w, big_h) = history.render, left.render, (s.x.display, s.y.display)
        old_stride = up_to(old_w, LANES)
        surfaces = address(history.surfaces)
        numbers = np.array(
            [
                left.exposure, w, h, big_w, big_h, old_w, old_h, *history.jitter,
                c["history_sharpness"], c["gamma"], c["depth_margin"], c["depth_ramp"],
            ],
            np.float32,
        )  # fmt: skip
        inputs = (
            *(address(a) for a in (s.samples, s.nearest, s.edges, s.across, s.down)), s.stride,
            address(history.pixels), surfaces, surfaces + 4 * old_h * old_stride, old_stride,
            *(address(a) for a in (s.y.samples, s.y.weights, s.x.samples, s.x.weights)),
            *(address(a) for a in (s.x.first, s.x.near, s.y.first, s.y.near, numbers)),
            big_w, big_h, s.width,
        )  # fmt: skip
        outputs = (
            *(address(a) for a in (s.whole, s.halves, history.classes)), s.encoder.records.shape[1],
            address(s.encoder.records), s.half_stride, address(s.means),
        )  # fmt: skip

        def rows(y0: int, y1: int, worker: int) -> None:
            k = s.scratch[worker]
            own = (k.line, k.filtered, k.ring, k.slots, k.weights, k.warped, k.followed, k.seen, k.apart)
            self._gather(*inputs, y0, y1, *(address(a) for a in own), *outputs)

        self.bands.run(big_h, rows, multiple=2)
        depths, eroded, to = address(s.depths), address(s.eroded), address(left.surfaces)
        self.bands.run(h, lambda y0, y1, _: self._surfaces(depths, eroded, w, h, s.stride, y0, y1, to))

    def _enter(self, space: _Workspace) -> None:
        """What is known around, and the first layer that sees it."""
        s, (half_w, half_h), records = space, space.half, space.encoder.records

        def rows(y0: int, y1: int, worker: int) -> None:
            k = s.scratch[worker]
            self._around(
                address(s.means), half_w, half_h, s.half_stride, records.shape[1], y0, min(y1, half_h),
                address(k.tall), address(k.tent), address(records),
            )  # fmt: skip
            s.encoder.enter(y0, y1)

        self.bands.run(s.encoder.rows, rows, multiple=ALIGNED)

    def _compose(
        self, space: _Workspace, left: ClassifierHistory, image: Float32, weight: Float32 | None
    ) -> None:
        s, n, c, e = space, self.network, self.config, space.encoder
        (w, h), (big_w, big_h) = left.render, (s.x.display, s.y.display)
        records = address(e.records)
        decoder, hidden, mixing = n.decoder, n.hidden, n.mixing
        inputs = (*e.kept, address(e.pitches))
        layers = (
            decoder.weights, decoder.scale, decoder.bias, records, records,
            e.records.shape[1] * e.records.shape[2],
            hidden.weights, hidden.blocks, hidden.scale, hidden.bias,
        )  # fmt: skip
        last = (n.logits, n.logits_scale, mixing.words, mixing.weights, mixing.scale, mixing.bias)
        gathered = (
            address(left.classes), address(s.whole), address(s.halves), s.width, address(s.samples), s.stride,
            w, h, address(s.x.near), address(s.y.near), address(s.x.window), address(s.y.window),
        )  # fmt: skip
        outputs = (
            big_w, big_h, left.exposure, c["samples"], c["contraction"], address(left.pixels), address(image),
            0 if weight is None else address(weight), int(weight is not None),
        )  # fmt: skip

        def rows(y0: int, y1: int, worker: int) -> None:
            k = s.scratch[worker]
            read, said = address(k.read), address(k.hidden)
            self._finish(
                *inputs, read, read, *layers, said, said, *last, address(k.mixing), *gathered,
                address(k.near), address(k.factors), address(k.out), *outputs, y0, y1,
            )  # fmt: skip

        self.bands.run(s.half[1], rows)

    def _take(self, render: Size, display: Size) -> _Workspace:
        with self._lock:
            free = self._spaces.get((render, display))
            if free:
                return free.pop()
        return _Workspace(self, render, display)

    def _give(self, space: _Workspace, render: Size, display: Size) -> None:
        with self._lock:
            self._spaces.setdefault((render, display), []).append(space)


def _planes(frame: Frame) -> tuple[Float32, Float32, Float32]:
    color, depth, motion = (
        np.ascontiguousarray(a, np.float32) for a in (frame.color, frame.depth, frame.motion)
    )
    return color, depth, motion


def up_to(count: int, multiple: int) -> int:
    """The next multiple."""
    return -(-count // multiple) * multiple
