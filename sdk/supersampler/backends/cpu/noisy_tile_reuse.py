"""Progressive rendering: where nothing but noise changes, an image becomes the mean of all samples since."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import Call, load_kernels
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.noisy_tiles import NoisyTiles, TileMeasures
from supersampler.backends.cpu.static_tiles import Bool, Jitter, StaticTiles, Sums
from supersampler.backends.cpu.static_weights import INSIDE, StaticWeights, samples_per_pixel, weights_after
from supersampler.backends.cpu.structs import AddedSamples, AxisSamples, FrameInputs, NoisyFrame, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_state import MOVING, SETTLING, TileState
from supersampler.backends.cpu.tiles import runs_of
from supersampler.conventions.jitter import jitter_phase_count

_KERNELS = "backends.cpu.kernels.noisy_tiles"
NOISY_TILE_KERNELS = (f"{_KERNELS}.measure_noise", f"{_KERNELS}.add_noisy_samples")
_KEEP_AND_ADD, _ADD = 3, 2  # as in `kernels.noisy_tiles`
_MEASURES = 6


class NoisyTileReuse:
    """Decides which tiles only noise changes, and adds up their samples.

    Its kernels are loaded when they are first used.

    Args:
        pool: threads that compute.
    """

    def __init__(self, pool: ThreadPool) -> None:
        self._pool = pool

    @cached_property
    def _kernels(self) -> Mapping[str, Call]:
        return load_kernels(*NOISY_TILE_KERNELS)

    def follow(self, planes: FrameInputs, jitter: Jitter, previous: TileState, current: TileState) -> None:
        """Choose the tiles that are reused: those with the samples of two jitter periods fade to their mean.

        Args:
            planes: the frame, with the exposure of the previous one; 0 without one.
            jitter: of the frame.
            previous: state of the history.
            current: state of the next history, written to.
        """
        render = planes.depth.shape[1], planes.depth.shape[0]
        before = previous.static_tiles
        if before is None or before.render != render:
            before, previous = StaticTiles.empty(render), TileState(current.display)
        current.static_tiles = tiles = before.after(jitter, _no_fingerprints)
        current.weights = weights_after(
            previous.weights, jitter, tiles, current.display, render, current.least_samples
        )
        following = current.allocated_noise()
        if not planes.exposure:
            following.exposure, following.tiles[:] = 0.0, 0.0
            return
        noise = previous.noise or NoisyTiles(current.display)
        samples = _placed(planes, jitter, noise, following, np.zeros(1, np.uint8), current)
        measured = aligned((*following.counts.shape, _MEASURES))
        frame = NoisyFrame(samples, planes.depth, planes.motion, noise.exposure or planes.exposure)
        inputs, measure = pack(frame), self._kernels[NOISY_TILE_KERNELS[0]]
        self._pool.run_rects(
            "skip",
            [Rect(0, measured.shape[0], 0, measured.shape[1])],
            lambda box, _: measure(inputs, *box, address(measured)),
        )
        following.follow(noise, frame.exposure, TileMeasures.of_array(measured))
        period = jitter_phase_count((1.0 / samples_per_pixel(current.display, render)) ** 0.5)
        fade = np.clip(following.counts / period - 1.0, 0.0, 1.0)
        current.active, records = True, current.records
        records["state"] = np.where((fade > 0.0) & ~following.doubted, SETTLING, MOVING)
        records["fade"] = fade

    def add(self, planes: FrameInputs, jitter: Jitter, previous: TileState, current: TileState) -> None:
        """Make the sums of all tiles those after this frame."""
        following, noise = current.allocated_noise(), previous.noise or NoisyTiles(current.display)
        goes_on = (following.counts > 1.0) | following.doubted
        modes = np.where(goes_on, _KEEP_AND_ADD, _ADD * (following.counts > 0.0))
        if not modes.any():
            return
        samples = _placed(planes, jitter, noise, following, modes.astype(np.uint8), current)
        inputs, outputs = (pack(samples), address(noise.compensation)), address(following.compensation)
        add = self._kernels[NOISY_TILE_KERNELS[1]]
        self._pool.run_rects("skip", runs_of(modes > 0), lambda box, _: add(*inputs, *box, outputs))


def _no_fingerprints(wanted: Bool, _: int) -> Sums:
    """Read no tile: only the sequence of the jitter is followed."""
    return np.zeros(wanted.shape, np.uint64)


def _placed(
    planes: FrameInputs,
    jitter: Jitter,
    noise: NoisyTiles,
    following: NoisyTiles,
    modes: NDArray[np.uint8],
    current: TileState,
) -> AddedSamples:
    """Return a frame's samples with their places and weights: 1 on average, or all 1 in a new sequence."""
    height, width = planes.depth.shape
    weights, phase = current.weights, None
    if weights is not None:
        phase = weights.phase(jitter)
    if weights is None or phase is None:
        weights, phase = StaticWeights(current.display, (width, height), [jitter], reach=INSIDE), 0
    rows, columns = (AxisSamples(axis.sample[phase], axis.kind) for axis in (weights.rows, weights.columns))
    table = weights.table[phase] * np.float32(max(weights.frames * weights.per_pixel, 1.0))
    return AddedSamples(
        modes, noise.sums, following.sums, planes.color, rows, columns, table, table.shape[1], width,
        *current.display,
    )  # fmt: skip
