"""Convergence of static blocks on the CPU; same as `supersampler_model.ops.at_rest`."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import LANES, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import (
    ADDS,
    KEEPS,
    NO_MASK,
    RESTARTS,
    SUMS,
    AddedSamples,
    BlockSums,
    FrameInputs,
    RestSamples,
    ShownMean,
    pack,
)
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tiles import Bool, dilated, runs_of, scaled
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.at_rest import (
    AT_REST_HISTORY,
    BESIDE,
    BLOCK,
    COMMON,
    DARK,
    FLICKER,
    INNER,
    LEAST_WEIGHT,
    NOISE_FLICKER,
    NOISE_RATE,
    NOISE_SIGMAS,
    NOISE_WEIGHT,
    NOISY,
    OLDEST,
    ORDER,
    OUTER,
    PARTIAL,
    SHOWN,
    SHOWN_FROM,
    SPARKLING,
    TOLERANCE,
    UNIFORM,
    UNRESOLVED,
    WINDOWS,
    block_count,
    phase_count,
)

_KERNELS = "backends.cpu.kernels.at_rest"
AT_REST_KERNELS = tuple(
    f"{_KERNELS}.{name}" for name in ("sign_blocks", "sum_blocks", "add_samples", "show_mean", "freeze_mean")
)
Bytes = NDArray[np.uint8]
_SCRATCH = 3 * 3 * LANES
_GENERATIONS = itertools.count(1)


def next_generation() -> int:
    """Next unused generation of tiles."""
    return next(_GENERATIONS)


@dataclass
class RestState:
    """The history of static blocks. Arrays other than the mean are never written again: histories share them.

    Attributes:
        display, render: sizes of the image and of the frame.
        ages: (down, across) frames since a block changed, negative where it is frozen.
        tests: (3, down, across) sums of three tests; see `RestHistory` of the torch module.
        phases: (phases, 4) the table of jitters; see `RestHistory`.
        signatures: of each phase, (4, down, across); None where there is none.
        mean: (H, W, 4); None before the first samples. Where a block's age is 0, it means nothing.
        generations: (rows, columns) of tiles; in two histories equal ones mean an equal mean.
    """

    display: Size
    render: Size
    ages: Float32 = field(init=False)
    tests: Float32 = field(init=False)
    phases: Float32 = field(init=False)
    signatures: list[Float32 | None] = field(init=False)
    mean: Float32 | None = None
    generations: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.generations = np.zeros([-(-extent // TILE) for extent in self.display[::-1]], np.int64)
        self.begin(self.render)

    def begin(self, render: Size) -> None:
        """Forget all blocks: the frame has another size."""
        across, down = block_count(render)
        count = phase_count(self.display, render)
        self.render = render
        self.ages, self.tests = np.zeros((down, across), np.float32), np.zeros((3, down, across), np.float32)
        self.phases, self.signatures = np.zeros((count, 4), np.float32), [None] * count

    def allocated_mean(self) -> Float32:
        """Return the mean, allocated if need be."""
        if self.mean is None:
            self.mean = aligned((self.display[1], self.display[0], 4))
        return self.mean

    def tensor(self, name: str) -> Float32:
        """Return a copy of a history tensor of the contract."""
        if name == "phases":
            return self.phases.copy()
        if name == "static_blocks":
            return np.concatenate([self.ages[None], self.tests])[None]
        if name == "signatures":
            blank = np.zeros((4, *self.ages.shape), np.float32)
            return np.stack([blank if signature is None else signature for signature in self.signatures])
        mean = np.zeros((self.display[1], self.display[0], 4), np.float32)
        if self.mean is not None:
            at = blocks_at(self.display, self.render)
            known = (self.ages != 0.0)[at.rows][:, at.columns]
            mean[known] = self.mean[known]
        return np.ascontiguousarray(mean.transpose(2, 0, 1)[None])

    def load(self, tensors: Mapping[str, NDArray[np.generic]], generation: int) -> None:
        """Fill from history tensors of the contract."""
        mean, blocks, signatures, phases = (
            np.array(tensors[f"history.{name}"], np.float32) for name in AT_REST_HISTORY
        )
        self.ages, self.tests = blocks[0, 0].copy(), blocks[0, 1:].copy()
        self.signatures, self.phases = list(signatures), phases
        self.allocated_mean()[:] = mean[0].transpose(1, 2, 0)
        self.generations[:] = generation


class Cycle(NamedTuple):
    """The jitter of a frame: see `Cycle` of the torch module."""

    slot: int
    age: float
    period: float
    counts: bool
    phases: Float32


class _Seen(NamedTuple):
    """A frame as it is compared."""

    frame: Frame
    inputs: FrameInputs
    cycle: Cycle
    sampled: bool
    noisy: bool
    moving: Bool  # blocks with a sample that moves
    signature: Float32
    dark: float  # linear light below which differences do not show


class StaticBlocks(NamedTuple):
    """Masks and values of each block of a frame, (down, across); same as `StaticBlocks` in ops/at_rest.py."""

    cycle: Cycle
    noisy: bool
    known: Bool
    static: Bool
    moves: Bool
    verifies: Bool
    adds: Bool
    stays: Bool
    ages: Float32
    tests: Float32
    shares: Float32 = np.zeros((1, 1), np.float32)  # of `kernels.at_rest.show_mean`
    complete: Bool = np.zeros((1, 1), bool)  # blocks whose mean has the samples of a whole period
    freezes: Bool = np.zeros((1, 1), bool)

    @classmethod
    def of_all(
        cls, cycle: Cycle, noisy: bool, history: RestState, following: RestState, *, moves: bool
    ) -> "StaticBlocks":
        """Write the next history but for its mean where every block moves, or else every one stays frozen."""
        shape, blank = history.ages.shape, np.zeros_like(history.tests)
        all_of_them, none = np.ones(shape, bool), np.zeros(shape, bool)
        moving, staying = (all_of_them, none) if moves else (none, all_of_them)
        ages = blank[0] if moves else np.minimum(np.abs(history.ages) + np.float32(cycle.counts), OLDEST)
        following.ages, following.tests = (ages if moves else -ages), blank
        following.render, following.phases = history.render, cycle.phases
        following.signatures = list(history.signatures)
        shares = np.where(staying, np.float32(2.0), np.float32(0.0))
        return cls(
            cycle, noisy, staying, staying, moving, none, none, staying, ages, blank, shares, staying, none
        )

    def write(self, history: RestState, following: RestState, signature: Float32) -> "StaticBlocks":
        """Write the next history but for its mean; return what is shown and frozen, too."""
        cycle = self.cycle
        periods = self.ages / max(cycle.period, 1.0) * (cycle.period > 0.0)
        steady = (self.tests.max(axis=0) <= 0.0) & self.static
        fade = np.clip((periods - SHOWN_FROM) / (SHOWN - SHOWN_FROM), 0.0, 1.0) * (steady & ~self.adds)
        shares = np.where(self.ages > 0.0, -1.0, 0.0) if self.noisy else np.where(self.stays, 2.0, fade)
        due = self.verifies & (periods >= 2.0)
        freezes = due & steady
        if freezes.any() and history.mean is not None:
            freezes &= least_enough(history.mean, history.display, history.render)
        ages = np.where(due & ~freezes, np.float32(cycle.period), self.ages)
        following.ages = np.where(self.stays | freezes, -ages, ages).astype(np.float32)
        following.tests = np.where(due, np.float32(0.0), self.tests).astype(np.float32)
        following.render, following.phases = history.render, cycle.phases
        following.signatures = list(history.signatures)
        kept, reference = self.known & self.static, history.signatures[cycle.slot]
        if cycle.counts and not (kept | self.moves).all():
            following.signatures[cycle.slot] = (
                signature if reference is None else np.where(kept, reference, signature)
            )
        complete = (self.stays | (periods >= 1.0)) & (not self.noisy)
        return self._replace(shares=shares.astype(np.float32), complete=complete, freezes=freezes)

    def resting(self, display: Size, render: Size) -> Bool:
        """Return the tiles of a display, (rows, columns), where the method's own history is kept."""
        return ~any_in_tiles(~self.stays, display, render)

    @property
    def frozen(self) -> Bool:
        """Blocks that are frozen after the frame."""
        return self.stays | self.freezes

    @property
    def active(self) -> bool:
        """Whether a block has a mean."""
        return bool(self.ages.any())


class BlocksAt(NamedTuple):
    """Block of each row and column of a display, int32; first and last block of each tile, per axis."""

    rows: NDArray[np.int32]
    columns: NDArray[np.int32]


@lru_cache
def blocks_at(display: Size, render: Size) -> BlocksAt:
    """Return the blocks at the pixels of a display."""
    columns, rows = (
        np.minimum((2 * np.arange(full) + 1) * size // (2 * BLOCK * full), -(-size // BLOCK) - 1).astype(
            np.int32
        )
        for full, size in zip(display, render, strict=True)
    )
    return BlocksAt(rows, columns)


def any_in_tiles(blocks: Bool, display: Size, render: Size) -> Bool:
    """Return the tiles of a display, (rows, columns), with a pixel of one of these blocks."""
    shape = [-(-extent // TILE) for extent in display[::-1]]
    if not blocks.any() or blocks.all():
        return np.full(shape, blocks[0, 0])
    at = blocks_at(display, render)
    sums = np.pad(blocks.astype(np.int32), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    (top, bottom), (left, right) = (
        (a[::TILE], np.append(a[TILE - 1 :: TILE], a[-1:])[: len(a[::TILE])] + 1) for a in at
    )
    count = (
        sums[np.ix_(bottom, right)]
        - sums[np.ix_(top, right)]
        - sums[np.ix_(bottom, left)]
        + sums[np.ix_(top, left)]
    )
    return np.asarray(count > 0)


class AtRest:
    """Compares frames with their history, and fades images to means.

    Args:
        kernels: AT_REST_KERNELS, among others.
        pool: the threads that run them.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool = pool
        self._sign, self._sum, self._add, self._show, self._freeze = (
            kernels[name] for name in AT_REST_KERNELS
        )

    def compare(
        self, frame: Frame, inputs: FrameInputs, history: RestState, following: RestState, adds_samples: float
    ) -> StaticBlocks:
        """Compare each block with its signature of this phase; write the next history but for its mean.

        Args:
            frame: the frame.
            inputs: its arrays, with its exposure.
            history: of the previous frame.
            following: the next history.
            adds_samples: see `Executor.step`.
        """
        if history.render != frame.size:
            history = replace(history)
            history.begin(frame.size)
        sampled, noisy = adds_samples >= 1.0, adds_samples >= NOISY
        cycle = follow_jitter(frame.jitter, history.phases, sampled=sampled, noisy=noisy)
        moving, signature = self._signatures(frame, inputs)
        if moving.all():
            return StaticBlocks.of_all(cycle, noisy, history, following, moves=True)
        seen = _Seen(frame, inputs, cycle, sampled, noisy, moving, signature, DARK / inputs.exposure)
        age, was_frozen = np.abs(history.ages), history.ages < 0.0
        known = (age >= cycle.age) & (cycle.age > 0.0 and sampled and not noisy)
        changed, drift = self._changed(seen, history, known)
        if sampled:
            changed = changed | (was_frozen & ~known)
        if was_frozen.all() and not (changed.any() or moving.any()):
            return StaticBlocks.of_all(cycle, noisy, history, following, moves=False)
        restarts, moves = (dilated(mask, 1) if mask.any() else mask for mask in (changed, moving))
        static = ~(moves | restarts)
        verifies = known & static & ~was_frozen & cycle.counts
        blocks = StaticBlocks(
            cycle=cycle,
            noisy=noisy,
            known=known,
            static=static,
            moves=moves,
            verifies=verifies,
            adds=~moves & (restarts | ~known) & cycle.counts,
            stays=was_frozen & static,
            ages=np.minimum((age * static + cycle.counts) * ~moves, OLDEST).astype(np.float32),
            tests=self._tests(seen, history, verifies, np.where(static, drift, np.float32(0.0))),
        )
        return blocks.write(history, following, signature)

    def _changed(self, seen: "_Seen", history: RestState, known: Bool) -> tuple[Bool, Float32]:
        """Return the blocks that changed, and the mean residuals of noisy samples, or else the tests."""
        if seen.noisy:
            if not history.ages.any():
                return np.zeros_like(known), history.tests
            small = windows_of(self._sums(seen, history, np.ones_like(known)), WINDOWS[0])
            relative = small.residuals / (small.level + seen.dark)
            drift = history.tests + NOISE_RATE * (relative - history.tests)
            drift = (drift * (small.samples > 0.0)).astype(np.float32)
            return drifting(drift, small, seen.dark), drift
        reference = history.signatures[seen.cycle.slot]
        if reference is None or not known.any():
            return np.zeros_like(known), history.tests
        return differing(seen.signature, reference, seen.dark) & known & ~seen.moving, history.tests

    def _tests(self, seen: "_Seen", history: RestState, verifies: Bool, kept: Float32) -> Float32:
        """Return the tests of the next history; `kept`: where the frame confirms no mean."""
        if seen.noisy or not seen.cycle.counts:
            return kept
        if not verifies.any():
            return np.zeros_like(kept)
        near = windowed(
            dilated(verifies, WINDOWS[0]), WINDOWS[1]
        )  # large windows with a small one that is read
        read = spread(near, WINDOWS[1], verifies.shape) & (history.ages != 0.0)
        rows, columns = windows_around(read)
        sums = self._sums(seen, history, read)[:, rows, columns]
        steadiness = steadiness_of(windows_of(sums, WINDOWS[0]), windows_of(sums, WINDOWS[1]), seen.dark)
        tests = np.zeros_like(history.tests)
        tests[:, rows, columns] = history.tests[:, rows, columns] + steadiness
        return np.where(verifies, tests, np.float32(0.0))

    def _signatures(self, frame: Frame, inputs: FrameInputs) -> tuple[Bool, Float32]:
        (w, h), (across, down) = frame.size, block_count(frame.size)
        moving, signature = np.zeros((down, across), np.uint8), np.zeros((4, down, across), np.float32)
        reactive = NO_MASK if frame.reactive is None else np.ascontiguousarray(frame.reactive, np.float32)
        packed = pack(
            RestSamples(
                inputs.color, inputs.motion, reactive, int(frame.reactive is not None), _order_weights(),
                moving, signature, w, h, across, down,
            )
        )  # fmt: skip
        scratch = aligned((self._pool.threads, _SCRATCH + LANES))
        self._pool.run_rows(
            "rest", down, lambda y0, y1, worker: self._sign(packed, address(scratch[worker]), y0, y1)
        )
        return moving > 0, signature

    def _sums(self, seen: "_Seen", history: RestState, wanted: Bool) -> Float32:
        """Return the sums of the residuals of blocks, (SUMS, down, across); 0 where they are not wanted."""
        frame, inputs = seen.frame, seen.inputs
        (w, h), (across, down) = frame.size, block_count(frame.size)
        sums = np.zeros((SUMS, down, across), np.float32)
        if history.mean is None:
            return sums
        at = blocks_at(history.display, frame.size)
        (columns, column_weights), (rows, row_weights) = (
            _pixels_around(frame.size[axis], history.display[axis], float(frame.jitter[axis]))
            for axis in (0, 1)
        )
        ages, asked = np.abs(history.ages), wanted.astype(np.uint8)
        packed = pack(
            BlockSums(
                inputs.color, history.mean, rows, row_weights, columns, column_weights, at.rows, at.columns,
                ages, asked, sums, w, h, across, down, history.display[0],
            )
        )  # fmt: skip
        self._pool.run_rows("rest", down, lambda y0, y1, _: self._sum(packed, y0, y1))
        return sums

    def show(
        self,
        frame: Frame,
        inputs: FrameInputs,
        history: RestState,
        following: RestState,
        blocks: StaticBlocks,
        image: Float32,
        generation: int,
        held: NDArray[np.int64],
    ) -> None:
        """Write the next mean, and fade the image to it.

        Args:
            frame: the frame.
            inputs: its arrays.
            history: of the previous frame.
            following: the next history.
            blocks: from `compare`.
            image: (H, W, 3) the method's own.
            generation: of the tiles that are written.
            held: generations of the tiles of the mean that `following` holds.
        """
        if not blocks.active:
            following.generations = held
            return
        generations = self._add_samples(frame, inputs, history, following, blocks, generation, held)
        self._show_mean(frame, following, blocks, image)
        following.generations = generations

    def _show_mean(self, frame: Frame, following: RestState, blocks: StaticBlocks, image: Float32) -> None:
        """Fade the image to the mean, and write what freezes to the mean."""
        display, render = following.display, frame.size
        shown = blocks.shares != 0.0
        if not shown.any():
            return
        at, complete = blocks_at(display, render), blocks.complete.astype(np.float32)
        cycle = blocks.cycle if ((blocks.shares > 0.0) & (blocks.shares <= 1.0)).any() else None
        across, row_moments = (moments_of(cycle, axis, display[axis], render[axis]) for axis in (0, 1))
        pitch = up_to(display[0], LANES)
        column_moments = aligned((len(across), 2, pitch))
        column_moments[..., : display[0]] = across.transpose(0, 2, 1)
        packed = pack(
            ShownMean(
                following.allocated_mean(), image, blocks.shares, complete, at.rows, at.columns,
                row_moments, column_moments, len(row_moments), pitch, complete.shape[1], *display,
                NOISE_WEIGHT,
            )
        )  # fmt: skip
        boxes = scaled(runs_of(any_in_tiles(shown, display, render)), TILE, display)
        scratch = aligned((self._pool.threads, 5 * LANES))
        self._pool.run_rects(
            "rest", boxes, lambda box, worker: self._show(packed, address(scratch[worker]), *box)
        )
        if blocks.freezes.any():
            frozen, tiles = blocks.freezes.astype(np.uint8), any_in_tiles(blocks.freezes, display, render)
            boxes = scaled(runs_of(tiles), TILE, display)
            self._pool.run_rects("rest", boxes, lambda box, _: self._freeze(packed, address(frozen), *box))

    def _add_samples(
        self,
        frame: Frame,
        inputs: FrameInputs,
        history: RestState,
        following: RestState,
        blocks: StaticBlocks,
        generation: int,
        held: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Write the next mean but for what freezes; return the generations of its tiles."""
        display, render = following.display, frame.size
        same = history.render == render
        if not (blocks.adds.any() or blocks.freezes.any()) and np.array_equal(held, history.generations):
            return held
        before = np.abs(history.ages) > 0.0 if same else np.zeros(blocks.ages.shape, bool)
        begins = blocks.adds & ~(blocks.static & before)
        modes = np.where(blocks.adds, np.where(begins, RESTARTS, ADDS), np.where(blocks.ages > 0.0, KEEPS, 0))
        written = any_in_tiles(blocks.adds | blocks.freezes, display, render)
        stale = any_in_tiles(modes != 0, display, render) & (held != history.generations)
        generations = np.where(written, generation, np.where(stale, history.generations, held))
        tiles, packed_modes = written | stale, modes.astype(np.uint8)
        if not tiles.any():
            return generations
        at = blocks_at(display, render)
        (columns, column_weights), (rows, row_weights) = (
            _samples_around(render[axis], display[axis], float(frame.jitter[axis])) for axis in (0, 1)
        )
        packed = pack(
            AddedSamples(
                inputs.color, history.allocated_mean(), following.allocated_mean(), rows, row_weights,
                columns, column_weights, at.rows, at.columns, packed_modes, render[0], blocks.ages.shape[1],
                display[0],
            )
        )  # fmt: skip
        boxes = scaled(runs_of(tiles), TILE, display)
        self._pool.run_rects("rest", boxes, lambda box, _: self._add(packed, *box))
        return generations


def follow_jitter(jitter: tuple[float, float], phases: Float32, *, sampled: bool, noisy: bool) -> Cycle:
    """Find a jitter in the table of phases: see `follow_jitter` of the torch module."""
    given = np.array(jitter, np.float32)
    ages, periods = phases[:, 2], phases[:, 3]
    same = (np.abs(phases[:, :2] - given).sum(axis=1) < 1e-6) & (ages > 0.0)
    rank = np.where(same, 4.0 * OLDEST, np.where(ages > 0.0, ages, 2.0 * OLDEST)) - np.arange(len(phases))
    slot = int(rank.argmax())
    age = float(ages[slot]) if same[slot] else 0.0
    counts = sampled and (age != 1.0 or noisy)
    period = age if age > 0.0 and counts else float(periods[ages == 1.0].sum())
    table = phases.copy()
    if counts:
        table[:, 2] = np.minimum(ages + (ages > 0.0), OLDEST)
        table[slot] = *given, 1.0, period
    return Cycle(slot, age, period, counts, table)


def differing(signature: Float32, reference: Float32, dark: float) -> Bool:
    """Return where two signatures differ."""
    level = np.maximum(np.maximum(signature[:3], reference[:3]).max(axis=0), np.float32(dark**0.25))
    return np.asarray(np.abs(signature - reference).max(axis=0) > np.float32(TOLERANCE) * level)


class Windows(NamedTuple):
    """Moments over the window of each block: see `Windows` of the torch module."""

    samples: Float32
    level: Float32
    residuals: Float32
    square: Float32
    variance: Float32
    contrast: Float32


def windowed(blocks: NDArray[Any], side: int) -> NDArray[Any]:
    """Return the sums of (..., down, across) blocks in windows of `side` blocks; of masks, if any is set.

    At the edges, blocks are repeated.
    """
    down, across = blocks.shape[-2:]
    edges = [(0, 0)] * (blocks.ndim - 2) + [(0, -down % side), (0, -across % side)]
    whole = np.pad(blocks, edges, "edge")
    split = whole.reshape(*blocks.shape[:-2], -(-down // side), side, -(-across // side), side)
    return np.asarray(split.any(axis=(-3, -1)) if blocks.dtype == bool else split.sum(axis=(-3, -1)))


def windows_around(blocks: Bool) -> tuple[slice, slice]:
    """Return the rows and columns of the large windows with these blocks, and of one more on each side."""
    side, ranges = WINDOWS[1], []
    for axis, extent in enumerate(blocks.shape):
        found = np.flatnonzero(blocks.any(axis=1 - axis))
        first, last = (found[0], found[-1]) if found.size else (0, 0)
        ranges.append(slice(max(first // side - 1, 0) * side, min((last // side + 2) * side, extent)))
    return ranges[0], ranges[1]


def spread(windows: NDArray[Any], side: int, shape: tuple[int, ...]) -> NDArray[Any]:
    """Repeat each window for its blocks, up to a shape."""
    return windows.repeat(side, -2).repeat(side, -1)[..., : shape[-2], : shape[-1]]


def windows_of(sums: Float32, side: int) -> Windows:
    """Return the moments over windows of `side` blocks of the sums of residuals."""
    pooled = windowed(sums, side)
    count = pooled[:1]
    share = 1.0 / np.maximum(count, 1e-6)
    residuals, color, expected = (pooled[first : first + 3] * share for first in (1, 4, 7))
    square = np.square(residuals).sum(axis=0)
    moments = (
        count, expected.max(axis=0), residuals, square,
        np.maximum(pooled[10] * share[0] - square, 0.0),
        np.maximum(pooled[11] * share[0] - np.square(color).sum(axis=0), 0.0),
    )  # fmt: skip
    return Windows(*(spread(moment, side, sums.shape).astype(np.float32) for moment in moments))


def steadiness_of(small: Windows, large: Windows, dark: float) -> Float32:
    """Return how far residuals are over the limits, (3, down, across); see `steadiness` in torch."""
    uniform = _excess(small.square, small.variance, UNIFORM, small, dark)
    partial = _excess(small.square, small.variance, PARTIAL, small, dark)
    sparkling = np.maximum(small.contrast - SPARKLING * np.square(small.level), 0.0)
    contrast = small.contrast + np.float32(BESIDE) * _widened(small.contrast, WINDOWS[0])
    explained = contrast + np.float32(1.0 / UNRESOLVED - 1.0) * sparkling
    tests = [
        np.minimum(_widened(uniform, WINDOWS[0]), partial),
        _excess(large.square, large.variance, COMMON, large, dark),
        _excess(small.variance, explained, UNRESOLVED, small, dark),
    ]
    return np.stack(tests).astype(np.float32)


def _excess(
    square: NDArray[Any], variance: NDArray[Any], ratio: float, window: Windows, dark: float
) -> Float32:
    level = np.square(window.level + dark)
    excess: Float32 = np.clip((square - ratio * variance) / level - FLICKER * FLICKER, -OLDEST, OLDEST)
    return excess


def _widened(blocks: Float32, reach: int) -> Float32:
    """Return the maxima over the blocks up to `reach` away on both axes."""
    for axis, extent in enumerate(blocks.shape):
        index = np.arange(extent)
        shifts = (np.clip(index + step, 0, extent - 1) for step in range(-reach, reach + 1))
        blocks = np.maximum.reduce([blocks.take(shift, axis) for shift in shifts])
    return blocks


def drifting(drift: Float32, window: Windows, dark: float) -> Bool:
    """Return where a running mean of relative residuals is more than noise."""
    frames = NOISE_RATE / (2.0 - NOISE_RATE)
    noise = np.sqrt(window.variance * frames / np.maximum(window.samples[0], 1.0)) / (window.level + dark)
    return np.asarray(np.abs(drift).max(axis=0) > NOISE_FLICKER + NOISE_SIGMAS * noise)


@lru_cache
def nearest_pixels(display: Size, render: Size) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the columns and rows of the pixels nearest to the centres of samples."""
    columns, rows = (
        np.minimum((2 * np.arange(size) + 1) * full // (2 * size), full - 1).astype(np.int32)
        for full, size in zip(display, render, strict=True)
    )
    return columns, rows


def least_enough(mean: Float32, display: Size, render: Size) -> Bool:
    """Return the blocks whose pixels nearest to samples have enough samples."""
    columns, rows = nearest_pixels(display, render)
    lacks = ~(mean[..., 3][rows][:, columns] >= LEAST_WEIGHT)
    across, down = block_count(render)
    padded = np.pad(lacks, ((0, down * BLOCK - render[1]), (0, across * BLOCK - render[0])), "edge")
    return np.asarray(~padded.reshape(down, BLOCK, across, BLOCK).any(axis=(1, 3)))


def moments_of(cycle: Cycle | None, axis: int, display: int, render: int) -> Float32:
    """Return the weights of samples near the pixels of an axis in each phase, and these times offsets.

    Returns:
        (phases, n, 2); without a cycle, of no phase.
    """
    if cycle is None:
        return np.zeros((0, display, 2), np.float32)
    ages = cycle.phases[:, 2]
    jitter = cycle.phases[(ages > 0.0) & (ages <= cycle.period), axis]
    return np.stack([_moments(float(j), display, render) for j in jitter])


@lru_cache(1024)
def _moments(jitter: float, display: int, render: int) -> Float32:
    (_, weights), offsets = _samples_around(render, display, jitter), _offsets(render, display, jitter)
    return np.stack([weights.sum(axis=1), (weights * offsets).sum(axis=1)], axis=-1).astype(np.float32)


def _places(render: int, display: int, jitter: float) -> Float32:
    """Return the places of the pixels of an axis among its samples, with the torch module's arithmetic."""
    half = np.float32(0.5)
    pixel = np.arange(display, dtype=np.float32)
    places: Float32 = (pixel + half) * np.float32(render) / np.float32(display) - half - np.float32(jitter)
    return places


def _offsets(render: int, display: int, jitter: float) -> Float32:
    """Return the offsets (display, 2) of the samples around each pixel, display pixels."""
    place = _places(render, display, jitter)[:, None]
    sample = np.floor(place) + np.arange(2, dtype=np.float32)
    offsets: Float32 = (sample - place) * np.float32(display / render)
    return offsets


@lru_cache(512)
def _samples_around(render: int, display: int, jitter: float) -> tuple[NDArray[np.int32], Float32]:
    """Return the two samples around each pixel of an axis and their weights, (display, 2) each."""
    place = _places(render, display, jitter)[:, None]
    sample = np.floor(place) + np.arange(2, dtype=np.float32)
    weight = np.clip((OUTER - np.abs(_offsets(render, display, jitter))) / (OUTER - INNER), 0.0, 1.0)
    inside = (sample >= 0) & (sample <= render - 1)
    return np.clip(sample, 0, render - 1).astype(np.int32), (weight * inside).astype(np.float32)


@lru_cache(512)
def _pixels_around(render: int, display: int, jitter: float) -> tuple[NDArray[np.int32], Float32]:
    """Return the two pixels around each sample of an axis and their bilinear weights, (render, 2) each."""
    half = np.float32(0.5)
    position = (np.arange(render, dtype=np.float32) + half + np.float32(jitter)) * np.float32(display)
    position = position / np.float32(render) - half
    first = np.floor(position)
    pixels = first[:, None] + np.arange(2, dtype=np.float32)
    weights = np.stack([1.0 - (position - first), position - first], axis=-1).astype(np.float32)
    return np.clip(pixels, 0, display - 1).astype(np.int32), weights


@lru_cache
def _order_weights() -> Float32:
    """Return the weights of four rows of sixteen samples in the last value of a signature: (4, 48)."""
    order = np.arange(3 * BLOCK * BLOCK, dtype=np.float32) * np.float32(ORDER)
    weights = (2.0 * (order - np.floor(order)) - 1.0) / (BLOCK * BLOCK)
    by_sample = weights.reshape(3, BLOCK, BLOCK).transpose(1, 2, 0)  # rows, columns, channels
    return np.ascontiguousarray(np.tile(by_sample.reshape(BLOCK, -1), (1, LANES // BLOCK)), np.float32)
