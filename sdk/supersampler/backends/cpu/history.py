"""`CpuHistory`: the history tensors of a method in the memory layout of its kernels."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.at_rest import RestState, next_generation
from supersampler.backends.cpu.layout import LANES, PAD, TILE
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.frame import Float32, Size
from supersampler.methods.at_rest import AT_REST_HISTORY
from supersampler.methods.spec import HALF, PREVIOUS, MethodSpec, Shape

_UINT8_ONE = np.float32(255.0)
_HALF_WRITTEN = -1


class Plane(NamedTuple):
    """An array of interleaved channels that holds one or more history tensors of one size.

    Attributes:
        tensors: names of the tensors, in the order of their channels.
        channels: number of channels, which may be more than those of the tensors.
        dtype: float32, or uint8 with 255 for 1.
    """

    tensors: tuple[str, ...]
    channels: int
    dtype: type[np.generic] = np.float32


class HistoryLayout:
    """The arrays that hold the history tensors of a method. Jitter and exposure are Python numbers.

    Args:
        spec: the method.
        planes: the arrays by name; the first one starts with linear RGB at display size.
        glare: name of the tensor whose last channel, in [0, 1], is increased by GLARE times the number of
            glaring frames; None for a method that does not count them.

    Attributes:
        planes, glare: as given.
        rests: whether the method converges at rest.
        values: number of values of each other tensor of shape (1, n), by name.
    """

    def __init__(self, spec: MethodSpec, planes: Mapping[str, Plane], glare: str | None = None) -> None:
        self.planes, self.glare, self._spec = planes, glare, spec
        self.rests = "static_mean" in spec.history
        self.values = {
            name: int(shape[1])
            for name, shape in spec.history.items()
            if len(shape) == 2 and name not in ("jitter", *AT_REST_HISTORY)
        }

    def size(self, plane: Plane) -> Shape:
        """Return the size of a plane: DISPLAY, HALF or PREVIOUS."""
        return self._spec.history[plane.tensors[0]][2:]

    def shape(self, plane: Plane, display: Size, render: Size) -> tuple[int, int, int]:
        """Return (height, width, channels) of a plane; rows of PREVIOUS size are padded at both ends."""
        size = self.size(plane)
        if size == PREVIOUS:
            return render[1], up_to(render[0], LANES) + 2 * PAD, plane.channels
        part = 2 if size == HALF else 1
        return -(-display[1] // part), -(-display[0] // part), plane.channels

    def channels(self, plane: Plane) -> dict[str, slice]:
        """Return the channels of each tensor in a plane."""
        found, first = {}, 0
        for name in plane.tensors:
            count = int(self._spec.history[name][1])
            found[name] = slice(first, first + count)
            first += count
        return found


class Generations(NamedTuple):
    """Generations of a history's arrays; see `CpuHistory`."""

    tiles: NDArray[np.int64]
    frame: int
    mean: NDArray[np.int64]


class CpuHistory:
    """The history after a frame; empty at first.

    Args:
        layout: layout of the method's history.
        display: size of the planes.
        render: size of the frame.
        image: size of the image; None: that of the planes.

    Attributes:
        render: size of the frame.
        arrays: planes by name; the padding of those of PREVIOUS size repeats the border.
        values: other tensors, (n,) each, by name.
        rest: what stands still; None for a method without it.
        generations: (rows, columns) of tiles; in two histories equal ones mean equal planes.
        jitter: jitter of the frame.
        exposure: exposure of the frame by `followed_exposure`; 0 before the first frame.
        glares: whether pixels may hold counts of glaring frames.
        frame_generation: in two histories equal ones mean equal arrays of the frame's size.
    """

    def __init__(self, layout: HistoryLayout, display: Size, render: Size, image: Size | None = None) -> None:
        self._layout, self._display, self.render = layout, display, render
        self.arrays: dict[str, NDArray[Any]] = {
            name: aligned(layout.shape(plane, display, render), plane.dtype)
            for name, plane in layout.planes.items()
        }
        self.values = {name: np.zeros(count, np.float32) for name, count in layout.values.items()}
        self.rest = RestState(image or display, render) if layout.rests else None
        self.generations = np.zeros([-(-extent // TILE) for extent in display[::-1]], np.int64)
        self.jitter, self.exposure, self.glares = (0.0, 0.0), 0.0, False
        self.frame_generation = 0

    def fits(self, display: Size, render: Size, image: Size) -> bool:
        """Return whether these arrays can hold the history after a frame of this size; see `__init__`."""
        free = PREVIOUS not in map(self._layout.size, self._layout.planes.values())
        same = self._display == display and (self.rest is None or self.rest.display == image)
        return same and (free or self.render == render)

    def begin_step(self) -> Generations:
        """Return the generations, and mark all arrays as half written until this step has ended."""
        rest = self.rest
        held = Generations(
            self.generations, self.frame_generation, self.generations if rest is None else rest.generations
        )
        self.generations, self.frame_generation = np.full_like(held.tiles, _HALF_WRITTEN), _HALF_WRITTEN
        if rest is not None:
            rest.generations = np.full_like(held.mean, _HALF_WRITTEN)
        return held

    def keep_frame(self, previous: "CpuHistory", held: int) -> None:
        """Copy everything except tiles from the previous history: no tile of this frame is computed.

        Args:
            previous: the history of the previous frame.
            held: generation of this history's arrays of the frame's size.
        """
        self.jitter, self.exposure, self.glares = previous.jitter, previous.exposure, previous.glares
        for name, values in previous.values.items():
            self.values[name][:] = values
        for name, plane in self._layout.planes.items():
            if self._layout.size(plane) == PREVIOUS and held != previous.frame_generation:
                self.arrays[name][:] = previous.arrays[name]
        self.frame_generation = previous.frame_generation

    def tiled(self) -> list[tuple[int, NDArray[Any]]]:
        """Return the planes that consist of tiles, each with the side of a tile in its pixels."""
        sizes = ((name, self._layout.size(plane)) for name, plane in self._layout.planes.items())
        return [
            (TILE // 2 if size == HALF else TILE, self.arrays[name])
            for name, size in sizes
            if size != PREVIOUS
        ]

    def tensor(self, name: str) -> Float32:
        """Return a copy of a history tensor, NCHW, by its name in the graph."""
        own = name.removeprefix("history.")
        if self.rest is not None and own in AT_REST_HISTORY:
            return self.rest.tensor(own)
        if own == "jitter":
            return np.array([self.jitter], np.float32)
        if own == "exposure":
            return np.array([self.exposure], np.float32)
        if own in self.values:
            return self.values[own][None].copy()
        key, plane = next(item for item in self._layout.planes.items() if own in item[1].tensors)
        pixels = self.arrays[key][..., self._layout.channels(plane)[own]]
        if self._layout.size(plane) == PREVIOUS:
            pixels = pixels[:, PAD : PAD + self.render[0]]
        if plane.dtype == np.uint8:
            pixels = pixels / _UINT8_ONE
        return np.ascontiguousarray(pixels.transpose(2, 0, 1)[None])

    def load(self, tensors: Mapping[str, NDArray[Any]]) -> None:
        """Fill from all history tensors, NCHW."""
        self.generations[:] = self.frame_generation = generation = next_generation()
        if self.rest is not None:
            self.rest.load(tensors, generation)
        for key, plane in self._layout.planes.items():
            array = self.arrays[key]
            for name, channels in self._layout.channels(plane).items():
                pixels = tensors[f"history.{name}"][0].transpose(1, 2, 0)
                if self._layout.size(plane) == PREVIOUS:
                    after = array.shape[1] - pixels.shape[1] - PAD
                    pixels = np.pad(pixels, ((0, 0), (PAD, after), (0, 0)), "edge")
                if plane.dtype == np.uint8:
                    pixels = np.clip(np.round(pixels * _UINT8_ONE), 0.0, _UINT8_ONE)
                array[..., channels] = pixels
        for name, values in self.values.items():
            values[:] = tensors[f"history.{name}"][0]
        self.exposure = float(tensors["history.exposure"][0])
        if "history.jitter" in tensors:
            x, y = (float(j) for j in tensors["history.jitter"][0])
            self.jitter = x, y
        glare = self._layout.glare
        self.glares = glare is not None and bool(tensors[f"history.{glare}"][0, -1].max() > 1.0)
