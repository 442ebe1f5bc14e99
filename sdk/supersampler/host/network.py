"""The network of `classifier` in bytes, level by level; the layers after them are in its finish."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Size
from supersampler.host.bands import Bands, Box, BoxWork
from supersampler.host.compiler import Call
from supersampler.host.layout import RECORD, TILE
from supersampler.host.memory import address, aligned
from supersampler.host.tiles import Tiles

Bytes = NDArray[np.uint8]
KEPT = (16, 8, 4, 4)  # bytes that each level has for a pixel among the decoder's 32
ALIGNED = 8  # the deepest level is at 1/8 of the packed size; rows beyond that are not cut from its last ones
ROOM = 16  # pixels after a row: kernels do several at once
SIX = 6  # so many; they write nothing beyond a row that is at least as long


LAYERS = ("network.enter", "network.descend", "network.level")


class Layer:
    """Weights of a layer, and how its sums become bytes or values: addresses."""

    def __init__(self, arrays: dict[str, NDArray[Any]], name: str) -> None:
        self._arrays = [arrays[f"{name}.{part}"] for part in ("weights", "scale", "bias")]
        self.weights, self.scale, self.bias = (address(array) for array in self._arrays)
        self.blocks, self.words = self._arrays[0].shape[:2]  # of the last: outputs, words
        self.outputs = len(self._arrays[1])


class ByteNetwork:
    """Weights of all layers.

    Args:
        path: network.npz of a model folder.
        kernels: LAYERS.
    """

    def __init__(self, path: Path, kernels: Mapping[str, Call]) -> None:
        with np.load(path) as file:
            arrays = {name: np.ascontiguousarray(file[name]) for name in file.files}
        self.levels = [
            tuple(Layer(arrays, f"{level}.{part}") for part in ("first", "spatial", "last"))
            for level in range(len(KEPT))
        ]
        self.decoder, self.hidden, self.mixing = (Layer(arrays, n) for n in ("decoder", "hidden", "mixing"))
        self.logits, self.logits_scale = arrays["logits.first"].item(), arrays["logits.scale"].item()
        self.enter, self.descend, self.level = (kernels[name] for name in LAYERS)


class _Level:
    """Buffers of a level: x within a border of one pixel, and what it gives; rows at which it may be cut."""

    def __init__(self, layers: tuple[Layer, ...], width: int, height: int, multiple: int) -> None:
        self.first, self.spatial, self.last = layers
        self.width, self.height, self.multiple = width, height, multiple
        self.given = -(-4 * self.first.words // ROOM) * ROOM  # channels of the level above, pooled
        self.x: Bytes = aligned((height + 2, width + ROOM, self.first.outputs), np.uint8)
        self.out: Bytes = aligned((height, width + ROOM, self.last.outputs), np.uint8)

    def row_of(self, image: Bytes) -> int:
        """Bytes from row to row."""
        return int(image.shape[1] * image.shape[2])


class Encoder:
    """The encoder at one size.

    Attributes:
        records: (half height, row, RECORD) words, what is known of packed pixels.
        kept: addresses of what each level gives.
        pitches: bytes a pixel of each, then bytes a row.
    """

    def __init__(self, network: ByteNetwork, half: Size, bands: Bands) -> None:
        self._bands = bands
        width, height = (-(-extent // ALIGNED) * ALIGNED for extent in half)
        self.records = aligned((half[1], width + ROOM, RECORD), np.int32)
        self._levels = [
            _Level(layers, width >> level, height >> level, ALIGNED >> level)
            for level, layers in enumerate(network.levels)
        ]
        most = max((level.width + ROOM) * max(level.given, level.spatial.outputs) for level in self._levels)
        self._lines = aligned((bands.threads, most), np.uint8)
        lines = [address(line) for line in self._lines]
        self._first = [_entering(network, self._levels[0], self.records, half)]
        self._first += [_descending(network, depth, self._levels, lines) for depth in range(1, len(KEPT))]
        self._others = [_encoding(network, level, lines) for level in self._levels]
        self.kept = [address(level.out) for level in self._levels]
        pitches = [level.last.outputs for level in self._levels]
        rows = [level.row_of(level.out) for level in self._levels]
        self.pitches = np.array([*pitches, *rows], np.int32)

    def run(self, tiles: Tiles, around: BoxWork) -> None:
        """All of it.

        Args:
            tiles: that it is run for.
            around: completes the records of a box, which may be the same box again.
        """

        def enter(box: Box, worker: int) -> None:
            around(box, worker)
            self._first[0](box, worker)

        for depth, level in enumerate(self._levels):
            boxes = tiles.boxes(TILE // 2 >> depth, (level.width, level.height), halo=True)
            self._run_level(level, boxes, self._first[depth] if depth else enter, self._others[depth])

    def _run_level(self, level: _Level, boxes: Sequence[Box], first: BoxWork, others: BoxWork) -> None:
        """All layers of a level, of which the others see one pixel around them."""
        cover = partial(self._bands.cover, "encode", boxes, multiple=level.multiple)
        if len(boxes) > 1 or level.width < SIX:
            cover(first)
            cover(others)
            return

        def all_layers(box: Box, worker: int) -> None:
            # a row more on either side, in place of a wait: what two threads both write is the same
            (whole,) = boxes
            first(box._replace(y0=max(box.y0 - 1, whole.y0), y1=min(box.y1 + 1, whole.y1)), worker)
            others(box, worker)

        cover(all_layers)


def _entering(network: ByteNetwork, level: _Level, records: NDArray[np.int32], half: Size) -> BoxWork:
    """The first layer of all, of packed pixels."""
    layer = level.first
    arguments = (
        address(records), RECORD, records.shape[1] * RECORD, layer.words, layer.weights, layer.blocks,
        layer.scale, layer.bias, address(level.x), layer.outputs, level.row_of(level.x), level.width, *half,
    )  # fmt: skip
    return lambda box, _: network.enter(*arguments, *box)


def _descending(network: ByteNetwork, depth: int, levels: Sequence[_Level], lines: list[int]) -> BoxWork:
    """The first layer of a deeper level."""
    above, level = levels[depth - 1 : depth + 1]
    layer, first = level.first, KEPT[depth - 1] * 4 ** (depth - 1)
    arguments = address(above.out), above.last.outputs, above.row_of(above.out), first, level.given
    more = (
        layer.words, layer.weights, layer.blocks, layer.scale, layer.bias, address(level.x),
        layer.outputs, level.row_of(level.x), level.width,
    )  # fmt: skip
    return lambda box, worker: network.descend(*arguments, lines[worker], lines[worker], *more, *box)


def _encoding(network: ByteNetwork, level: _Level, lines: list[int]) -> BoxWork:
    """The other two layers of a level."""
    spatial, last = level.spatial, level.last
    arguments = (
        address(level.x), level.first.outputs, level.row_of(level.x), spatial.outputs, spatial.weights,
        spatial.scale, spatial.bias,
    )  # fmt: skip
    more = (
        last.weights, last.blocks, last.scale, last.bias, address(level.out), last.outputs,
        level.row_of(level.out),
    )  # fmt: skip
    return lambda box, worker: network.level(*arguments, lines[worker], lines[worker], *more, *box)
