"""What static-tile reuse keeps of each static tile of the display from frame to frame."""

import itertools
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import TOLERANCE
from supersampler.backends.cpu.layout import STATIC_TILE, SUM_VALUES
from supersampler.backends.cpu.memory import aligned
from supersampler.backends.cpu.noisy_tiles import NoisyTiles, noisy_tile_specs
from supersampler.backends.cpu.static_tiles import PHASES, Jitter, StaticTiles, mostly, static_tile_specs
from supersampler.backends.cpu.static_weights import (
    LEAST_SAMPLES,
    StaticWeights,
    samples_per_pixel,
    weights_after,
)
from supersampler.backends.cpu.tiles import FILTER_REACH, SAMPLE_REACH, Bool, Tiles, tiles_reading, tiles_with
from supersampler.frame import Float32, Size
from supersampler.methods.array_spec import ArraySpec, values_of

MOVING, SETTLING, RESTING = range(3)
"""States of a tile: the method computes it; its image fades to the mean of its samples; it is copied."""
TILE_RECORD = np.dtype(
    [
        ("state", np.int8),
        ("fade", np.float32),
        ("matched", np.int32),
        ("count", np.int32),
        ("phases", np.uint64, (PHASES // 64,)),
        ("failed", np.bool_),
        ("motionless", np.bool_),
    ]
)
FADE_FRAMES = 16
"""Frames in which a tile fades to a mean of samples that a whole period has confirmed; else the fade takes a
period, in which each frame confirms one phase."""
FADE_POWER = 8
"""Shape of the fade. A method that converges goes on doing so; with a slower first frame than this the fade
would fall behind it."""
UNSTEADY_FRAMES = 8
"""Consecutive frames in which most tiles changed, after which none settles until fewer do."""
SPARSE_FRAMES = 64
"""Frames after which a tile rests on the method's image, where a jitter sequence is too short for means."""

_GENERATIONS = itertools.count(1)


def next_generation() -> int:
    """Next unused tile generation."""
    return next(_GENERATIONS)


class TileState:
    """The static tiles of one history's image. Arrays are (rows, columns) of them, but `sums` and `work`.

    Args:
        display: size of the image.
        least_samples: see there.

    Attributes:
        generations: equal generations in two histories mean equal pixels; 0 is no content.
        work: share of a full step's work that was done for each tile of TILE pixels, in [0, 1].
        static_tiles: which tiles of the frame were the same; None before the first frame.
        weights: of the samples in `sums`; None where there are none.
        records: of TILE_RECORD:
            state: MOVING, SETTLING or RESTING.
            fade: frames since the tile settles, as a part of those that the fade takes, in [0, 1].
            matched: consecutive frames in which all samples that the tile reads were the same.
            count, phases: number and bits of the phases of the period whose samples are in `sums`.
            failed: samples were of an image that changed; none are added until the tile is the same or moves.
            motionless: nothing moved in the frame.
        sums: (H, W, SUM_VALUES) sums over the samples in each pixel: weight times linear RGB, weight, and
            weight times squared distance from the mean; None before the first.
        sum_generations: like `generations`, for `sums`.
        added: tiles whose samples of this frame belong into `sums`.
        noise: what is accumulated where only noise changes; None unless skip="accumulate" asked for it.
        active: whether any tile is reused, has samples or may settle.
    """

    def __init__(self, display: Size, least_samples: float = LEAST_SAMPLES) -> None:
        self.display, self.least_samples = display, least_samples
        shape = -(-display[1] // STATIC_TILE), -(-display[0] // STATIC_TILE)
        self.generations, self.sum_generations = np.zeros((2, *shape), np.int64)
        self.work = Tiles(tiles_with(np.ones(shape, bool), display)).work()
        self.records, self.added = np.zeros(shape, TILE_RECORD), np.zeros(shape, bool)
        self.sums: Float32 | None = None
        self.static_tiles: StaticTiles | None = None
        self.weights: StaticWeights | None = None
        self.noise: NoisyTiles | None = None
        self.active = False

    @property
    def converged(self) -> float:
        """Share of the tiles that rest, or whose mean has an error below that of skip="auto"."""
        if self.noise is not None and self.static_tiles is not None:
            per_pixel = samples_per_pixel(self.display, self.static_tiles.render)
            return float((self.noise.errors(per_pixel) <= TOLERANCE).mean())
        return float((self.records["state"] == RESTING).mean())

    def forget(self) -> None:
        """Drop all that was kept, as after a reset."""
        self.static_tiles, self.weights = None, None
        if self.active:
            self.records, self.added = np.zeros_like(self.records), np.zeros_like(self.added)
        elif self.records["failed"].any():
            self.records["failed"] = False
        self.active = False

    def allocated_sums(self) -> Float32:
        """Return `sums`, allocated if need be."""
        if self.sums is None:
            self.sums = aligned((self.display[1], self.display[0], SUM_VALUES))
        return self.sums

    def allocated_noise(self) -> NoisyTiles:
        """Return `noise`, allocated if need be."""
        if self.noise is None:
            self.noise = NoisyTiles(self.display)
        return self.noise

    def follow(self, previous: "TileState", tiles: StaticTiles, jitter: Jitter) -> None:
        """Continue from the previous state: which tiles are reused, and whose samples are added.

        Args:
            previous: the previous state.
            tiles: after this frame.
            jitter: of this frame.
        """
        before, self.static_tiles = previous.static_tiles, tiles
        weights = weights_after(
            previous.weights, jitter, tiles, self.display, tiles.render, self.least_samples
        )
        self.weights = weights
        if before is not None and self._moves_or_fails(before, tiles, previous.records["failed"]):
            self.records["failed"] = self._reading(tiles, tiles.changed)
            return
        self.active, records = True, previous.records.copy()
        if weights is not previous.weights:
            records["state"], records["count"], records["phases"] = MOVING, 0, 0
        self.records = records
        self._choose_samples(tiles, jitter, tiles.confirmed if before is None else before.confirmed)
        same = ~self._reading(tiles, ~tiles.same, FILTER_REACH)
        records["matched"] = np.where(same, records["matched"] + 1, 0)
        state, fade = records["state"], records["fade"]
        state[~same] = MOVING
        if weights is not None:
            state[(state == SETTLING) & (fade == 1.0) & (previous.records["count"] == weights.frames)] = (
                RESTING
            )
            confirmed = ~self._reading(tiles, ~tiles.confirmed)
            frames = np.where(confirmed, FADE_FRAMES, max(weights.frames, FADE_FRAMES))
            fade[state == SETTLING] = np.minimum(fade + 1.0 / frames, 1.0)[state == SETTLING]
        fade[state == MOVING] = 0.0

    def _moves_or_fails(self, before: StaticTiles, tiles: StaticTiles, failed: Bool) -> bool:
        """Whether so few tiles can settle that samples are not worth their time.

        Either most tiles of the frame moved twice, or most go on changing and half of the image failed or
        moves: after a single change of the light none fails, and samples are added anew.
        """
        if mostly(before.moving) and mostly(tiles.moving):
            return True
        if tiles.unsteady <= UNSTEADY_FRAMES:
            return False
        return bool((failed | self._reading(tiles, tiles.moving)).mean() > 0.5)

    def _choose_samples(self, tiles: StaticTiles, jitter: Jitter, was_confirmed: Bool) -> None:
        """Choose the tiles whose samples are added to the sums, and those whose sums are dropped.

        Args:
            tiles: after this frame.
            jitter: of this frame.
            was_confirmed: `StaticTiles.confirmed` of the previous frame.
        """
        records, weights = self.records, self.weights
        moving, quiet = self._reading(tiles, tiles.moving), records["motionless"].copy()
        records["motionless"], self.added = ~moving, np.zeros(moving.shape, bool)
        if weights is None:
            return
        phase = weights.phase(jitter)
        word, bit = divmod(phase or 0, 64)
        held, changed = self._reading(tiles, tiles.held), self._reading(tiles, tiles.changed)
        same, confirmed = ~self._reading(tiles, ~tiles.same), ~self._reading(tiles, ~was_confirmed)
        phases, mask = records["phases"][..., word], np.uint64(0 if phase is None else 1 << bit)
        disproved = changed & ~moving & (phases & mask != 0)
        records["failed"] = (records["failed"] | (disproved & ~confirmed)) & ~moving & ~same
        dropped = disproved | (moving & ~confirmed)
        records["count"][dropped], records["phases"][dropped] = 0, 0
        if phase is not None:
            self.added = quiet & ~moving & ~held & ~records["failed"] & (phases & mask == 0)
            records["count"] += self.added
            phases[self.added] |= mask

    def _reading(self, tiles: StaticTiles, mask: Bool, reach: int = SAMPLE_REACH) -> Bool:
        """Return the tiles that read one of these tiles of the frame."""
        if not mask.any():
            return np.zeros(self.records.shape, bool)
        return tiles_reading(mask, self.display, tiles.render, reach, STATIC_TILE)

    def fade_parts(self, previous: "TileState") -> Float32:
        """Return the part of the way from the previous image to the mean that this frame goes.

        The method's fraction of the image is the FADE_POWER-th power of the remaining fraction of the fade.
        """
        method, before = ((1.0 - state.records["fade"]) ** FADE_POWER for state in (self, previous))
        return (1.0 - method / np.maximum(before, 1e-12)).astype(np.float32)

    def settle(self, errors: Float32, tolerance: float) -> None:
        """Let tiles that were computed settle.

        Args:
            errors: estimated root mean square error of the mean of each tile, of toned colors.
            tolerance: largest error with which a tile settles before its period is whole.
        """
        records, weights = self.records, self.weights
        state, matched = records["state"], records["matched"]
        if weights is None:
            state[matched >= SPARSE_FRAMES] = RESTING
        else:
            whole = records["count"] == weights.frames
            state[(state == MOVING) & (matched > 0) & (whole | (errors <= tolerance))] = SETTLING

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Return copies for `load`."""
        if self.static_tiles is None:
            return {}
        arrays = self.static_tiles.arrays()
        arrays |= {f"static.{name}": self.records[field].copy() for name, field in _SAVED.items()}
        if self.weights is not None and self.sums is not None:
            arrays["static.sequence"] = np.array(self.weights.jitter, np.float64)
            arrays["static.sums"] = self.sums.copy()
        return arrays if self.noise is None else arrays | self.noise.arrays()

    def load(self, arrays: Mapping[str, NDArray[Any]], render: Size) -> None:
        """Continue from arrays by `arrays`, of the shapes of `tile_state_specs`; the image is loaded apart.

        Args:
            arrays: these, and others.
            render: size of the last frame.

        Raises:
            ArgumentError: they contradict each other.
        """
        self.generations[:] = self.sum_generations[:] = next_generation()
        self.forget()
        if "static.frames" not in arrays:
            return
        self.static_tiles = StaticTiles.of_arrays(arrays, render)
        for name, field in _SAVED.items():
            self.records[field] = arrays[f"static.{name}"]
        phases = self.records["phases"]
        if "static.sums" not in arrays:
            phases[:] = 0
            self.records["state"][self.records["state"] == SETTLING] = MOVING
        else:
            sequence = [(float(x), float(y)) for x, y in arrays["static.sequence"][:PHASES]]
            self.weights = StaticWeights(self.display, render, sequence)
            self.allocated_sums()[:] = arrays["static.sums"]
            phases &= np.packbits(np.arange(PHASES) < len(sequence), bitorder="little").view(np.uint64)
        self.records["count"] = np.unpackbits(phases.view(np.uint8), axis=-1).sum(axis=-1)
        self.active = True
        self.noise = None
        if "static.noisy_sums" in arrays:
            self.allocated_noise().load(arrays)


_SAVED = {
    "states": "state",
    "fades": "fade",
    "matched_reads": "matched",
    "phases": "phases",
    "failed": "failed",
    "motionless": "motionless",
}
"""Names of saved arrays, and fields of TILE_RECORD."""


def tile_state_specs(names: Collection[str], display: Size, render: Size) -> dict[str, ArraySpec]:
    """Return the shapes and values that arrays by `TileState.arrays` must have; none without such a name.

    Args:
        names: of arrays, of any origin.
        display: size of the image.
        render: size of the last frame.
    """
    if not any(name.startswith("static.") for name in names):
        return {}
    tiles = tuple(-(-extent // STATIC_TILE) for extent in display[::-1])
    specs = static_tile_specs(render)
    specs |= {
        "static.states": ArraySpec("int8", tiles, (MOVING, RESTING)),
        "static.fades": ArraySpec("float32", tiles, (0.0, 1.0)),
        "static.matched_reads": ArraySpec("int32", tiles, (0, 1 << 30)),
        "static.phases": ArraySpec("uint64", (*tiles, PHASES // 64)),
        "static.failed": ArraySpec("bool", tiles),
        "static.motionless": ArraySpec("bool", tiles),
    }
    if {"static.sequence", "static.sums"} & {*names}:
        specs["static.sequence"] = ArraySpec("float64", ("sequence", 2), (-0.5, 0.5))
        specs["static.sums"] = ArraySpec("float32", (*display[::-1], SUM_VALUES), values_of("static.sums"))
    return specs | noisy_tile_specs(names, display)
