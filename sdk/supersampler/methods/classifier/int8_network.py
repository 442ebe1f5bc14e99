"""The int8 network of `classifier`: its weights, and the encoder, which runs level by level."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import LANES, PAD, PIXELS_AT_ONCE, RECORD_WORDS, TILE
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import Tiles
from supersampler.frame import Size
from supersampler.methods.classifier.network_file import KEPT, read_network
from supersampler.methods.classifier.structs import (
    EncodedLevels,
    FinishLayers,
    LayerWeights,
    LevelAbove,
    LevelBuffers,
    LevelScratch,
    NetworkInputs,
)
from supersampler.methods.model_info import ModelInfo

Bytes = NDArray[np.uint8]
LevelWork = Callable[[int, int, Rect, int], None]
ALIGNED = 8  # sizes are multiples of it: the deepest level has 1/8 of the packed size
ROOM = 16  # spare pixels after a row, because kernels compute several pixels at once
LEVEL = "methods.classifier.kernels.encode.level"


def _layer(arrays: Mapping[str, NDArray[Any]], name: str) -> LayerWeights:
    weights, scale, bias = (arrays[f"{name}.{part}"] for part in ("weights", "scale", "bias"))
    return LayerWeights(weights, scale, bias, *weights.shape[:2])


def network_inputs(half: Size) -> NetworkInputs:
    """Allocate the inputs of the network for this number of packed pixels."""
    row, stride = up_to(half[0], ALIGNED) + ROOM, up_to(half[0], LANES) + 2 * PAD
    records, means = aligned((half[1], row, RECORD_WORDS), np.int32), aligned((half[1], 2, stride))
    return NetworkInputs(records, means, *half, row, stride)


def level_scratch(inputs: NetworkInputs, line: Bytes) -> LevelScratch:
    """Allocate the scratch of one thread; line: of the bytes of a row."""
    signed, absolute, tent, codes = aligned((4, inputs.means_stride))
    return LevelScratch(signed, absolute, tent, codes.view(np.int32), line, line.view(np.int32))


class Int8Network:
    """The weights of all layers.

    Args:
        info: the model, whose folder has a network.npz.
        outputs: channels of the last layer.
        level: the kernel LEVEL.

    Attributes:
        precision: see `Executor`.

    Raises:
        ModelError: network.npz is damaged, or does not match the model's config.
    """

    precision = "int8"

    def __init__(self, info: ModelInfo, outputs: int, level: Call) -> None:
        arrays = read_network(info, outputs)
        self.levels = [
            tuple(_layer(arrays, f"{level}.{part}") for part in ("first", "spatial", "last"))
            for level in range(len(KEPT))
        ]
        decoder, hidden, blend = (_layer(arrays, name) for name in ("decoder", "hidden", "blend"))
        logits, scale = arrays["logits.first"].item(), arrays["logits.scale"].item()
        self.layers = FinishLayers(decoder, hidden, blend, logits, scale)
        self.level = level

    def buffers(self, half: Size, pool: ThreadPool) -> "Encoder":
        """Allocate the encoder for this number of packed pixels."""
        return Encoder(self, half, pool)


class _Level:
    """Buffers of a level: `x`, with a border of one pixel, and `out`. Threads split it at `multiple` rows."""

    def __init__(self, layers: tuple[LayerWeights, ...], width: int, height: int, multiple: int) -> None:
        self.first, self.spatial, self.last = layers
        self.width, self.height, self.multiple = width, height, multiple
        self.inputs = up_to(4 * self.first.words, LANES)  # channels, pooled from the level above
        self.x: Bytes = aligned((height + 2, width + ROOM, self.first.outputs), np.uint8)
        self.out: Bytes = aligned((height, width + ROOM, self.last.outputs), np.uint8)
        self.buffers = LevelBuffers(
            self.x, self.first.outputs, self.x.strides[0], self.spatial.outputs,
            self.out, self.last.outputs, self.out.strides[0], width,
        )  # fmt: skip


class Encoder:
    """The encoder at one size.

    Attributes:
        inputs: its inputs.
    """

    def __init__(self, network: Int8Network, half: Size, pool: ThreadPool) -> None:
        self._pool = pool
        width, height = (up_to(extent, ALIGNED) for extent in half)
        self.inputs = network_inputs(half)
        self._levels = [
            _Level(layers, width >> level, height >> level, ALIGNED >> level)
            for level, layers in enumerate(network.levels)
        ]
        most = max((level.width + ROOM) * max(level.inputs, level.spatial.outputs) for level in self._levels)
        self._scratch = [level_scratch(self.inputs, aligned((most,), np.uint8)) for _ in range(pool.threads)]
        scratch, inputs = [pack(one) for one in self._scratch], pack(self.inputs)
        self._work = [
            _level_work(network, self._levels, depth, inputs, scratch) for depth in range(len(KEPT))
        ]
        pitches = [level.buffers.out_pitch for level in self._levels]
        rows = [level.buffers.out_row for level in self._levels]
        first, second, third, fourth = (level.out for level in self._levels)
        levels = EncodedLevels(first, second, third, fourth, np.array([*pitches, *rows], np.int32))
        self._outputs = levels, network.layers, self.inputs

    def run(self, tiles: Tiles) -> tuple[EncodedLevels, FinishLayers, NetworkInputs]:
        """Compute all levels of the gathered tiles; return the structs that `finish_rows` reads."""
        for depth, (level, work) in enumerate(zip(self._levels, self._work, strict=True)):
            boxes = tiles.boxes(TILE // 2 >> depth, (level.width, level.height), halo=True)
            if len(boxes) > 1 or level.width < PIXELS_AT_ONCE:
                self._run_in_two_passes(level, boxes, work)
            else:
                self._run_in_one_pass(level, boxes[0], work)
        return self._outputs

    def _run_in_one_pass(self, level: _Level, whole: Rect, work: LevelWork) -> None:
        def run_layers(box: Rect, worker: int) -> None:
            # one more row on either side instead of waiting; two threads write the same values there
            work(max(box.y0 - 1, whole.y0), min(box.y1 + 1, whole.y1), box, worker)

        self._pool.run_rects("encode", [whole], run_layers, multiple=level.multiple)

    def _run_in_two_passes(self, level: _Level, boxes: Sequence[Rect], work: LevelWork) -> None:
        """Run the first layer on all boxes, then the others, which read its pixels in neighbouring boxes."""

        def run_first_layer(box: Rect, worker: int) -> None:
            work(box.y0, box.y1, box._replace(y1=box.y0), worker)

        def run_other_layers(box: Rect, worker: int) -> None:
            work(box.y0, box.y0, box, worker)

        for function in (run_first_layer, run_other_layers):
            self._pool.run_rects("encode", boxes, function, multiple=level.multiple)


def _level_work(
    network: Int8Network, levels: Sequence[_Level], depth: int, inputs: bytes, scratch: Sequence[bytes]
) -> LevelWork:
    """Return a function that runs a level: the first layer on rows y0 to y1 - 1, the others on a box."""
    above, level = levels[max(depth - 1, 0)], levels[depth]
    skipped = KEPT[depth - 1] * 4 ** (depth - 1) if depth else 0
    pooled = LevelAbove(
        above.out.reshape(-1)[skipped:],
        above.buffers.out_pitch,
        above.buffers.out_row,
        level.inputs if depth else 0,
    )
    arguments = inputs, *(pack(s) for s in (pooled, level.first, level.spatial, level.last, level.buffers))
    return lambda y0, y1, box, worker: network.level(*arguments, scratch[worker], y0, y1, *box)
