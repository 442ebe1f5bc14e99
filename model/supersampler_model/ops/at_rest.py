"""Convergence of static blocks: the mean of the samples of one jitter period, shown once it is confirmed.

A method keeps its own image. Beside it, the samples of each phase of the jitter are added once to a mean,
whose weights, jitter and light are then those of exactly one period. The mean is shown only after the samples
of the next period, phase by phase, were the same: only samples that repeat are known to be static.

The frame is divided into blocks of 4x4 samples. A block has a signature for each phase: the means of the
fourth roots of its samples, and a weighted sum of these that depends on their order. A signature is written
once and never updated, so that slow changes add up. A block restarts, with its neighbours, where a signature
differs, something moves, or the reactive mask is set. Where light fades, jumps or flickers, an edge creeps, a
screen scrolls, or the camera moves imperceptibly, the method's own image is shown.

Light that blinks with a divisor of the jitter period would pass this test. The residuals of the samples from
the mean are therefore tested over the period, too. Aliasing averages out over a window of samples, light does
not. A block is not shown where the mean residual of a window is large for the variance in it (UNIFORM in its
8x8 samples, or PARTIAL beside such a window, COMMON in 32x32), or where the mean does not predict the samples
(UNRESOLVED).

Samples of a path tracer never repeat. Where `adds_samples` is NOISY, all samples are added, and nothing is
confirmed or frozen. A block restarts where the mean residual of its small window, averaged over about eight
frames, is more than NOISE_FLICKER and the noise of the residuals explain.

A block that was confirmed for a whole period is frozen: its image is the mean, bit for bit, and no sample is
added. In a tile of the display whose blocks are all frozen, the method's own history does not change, and
where the whole frame is frozen, no history changes. A backend may therefore skip the method there.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods import at_rest as spec
from supersampler.methods.at_rest import BLOCK, WINDOWS
from supersampler.methods.constants import FULL_WEIGHT
from supersampler_model.ops import images
from supersampler_model.ops.color import bounded, sanitize, valid
from supersampler_model.ops.images import Size, fit, fit_axis, pick_columns, size_of
from supersampler_model.ops.motion import squared_length, usable_motion
from supersampler_model.ops.sampling import Bands, Grid, resample


class RestFrame(NamedTuple):
    """This frame, at render size."""

    color: Tensor  # (1, 3, h, w) linear RGB as given: any value
    motion: Tensor  # (1, 2, h, w) render pixels
    jitter: Tensor  # (1, 2) render pixels
    exposure: Tensor  # (1,) > 0
    reactive: Tensor  # (1, 1, h, w) over 0 where the history is not reliable
    adds_samples: Tensor  # (1,) 0: not sampled in this frame; NOISY: samples never repeat; else 1

    @property
    def is_sampled(self) -> Tensor:
        """(1,) 1 where the frame adds samples, else 0."""
        return (self.adds_samples >= 1.0).float()

    @property
    def is_noisy(self) -> Tensor:
        """(1,) 1 where a path tracer took the samples, else 0."""
        return (self.adds_samples >= spec.NOISY).float()


class RestHistory(NamedTuple):
    """The history tensors of `AT_REST_HISTORY`; zeros without a history.

    The channels of `blocks` are the age, negative where frozen, and the sums of three tests; with noisy
    samples the mean residual takes the place of the tests.
    """

    mean: Tensor  # (1, 4, H, W) linear RGB, and the sum of weights
    blocks: Tensor  # (1, 4, hb, wb)
    signatures: Tensor  # (phases, 4, hb, wb)
    phases: Tensor  # (phases, 4) jitter x and y, frames since it was seen, frames between its last two


class Cycle(NamedTuple):
    """The jitter of this frame, and when it was last seen."""

    slot: Tensor  # (1,) int64, its row in `phases`
    age: Tensor  # (1,) frames since it was last seen; 0 if it is new
    period: Tensor  # (1,) frames of a jitter period; 0 while it is unknown
    counts: Tensor  # (1,) 1 where the frame adds a phase; 0 without samples, or if the jitter did not change
    phases: Tensor  # (phases, 4) the next table


class StaticBlocks(NamedTuple):
    """Static blocks of this frame, (1, 1, hb, wb) each; 1 where the condition holds, else 0."""

    known: Tensor  # the block has a signature of this phase
    moves: Tensor  # something moves or is reactive in the block or beside it
    static: Tensor  # nothing moves or changes there
    adds: Tensor  # this frame's samples are added to the mean
    stays: Tensor  # the block was frozen and stays frozen
    age: Tensor  # frames since the block changed, this one included
    verifies: Tensor  # this frame confirms the mean
    tests: Tensor  # (1, 3, hb, wb) of the next history
    history: RestHistory  # of this frame's sizes, with the next signatures and phases
    cycle: Cycle
    at_pixels: "BlocksAtPixels"

    def resting(self, size: Size) -> Tensor:
        """Return (1, 1, n, m): 1 in tiles of an image of this size whose history does not change."""
        stays = self.at_pixels.resized(size).pick(self.stays)
        whole = fit(stays, size.width + spec.TILE - 1, size.height + spec.TILE - 1)
        return images.spread(-F.max_pool2d(-whole, spec.TILE), spec.TILE, size)

    def kept(self, before: Tensor, after: Tensor) -> Tensor:
        """Return the next history's tensor: `before` where the whole frame rests, else `after`.

        `before` may have another size where the frame does not rest.
        """
        for axis in range(2, after.dim()):
            before = fit_axis(before, axis, after.shape[axis])
        return torch.where((-self.stays).amax(dim=(1, 2, 3)) < 0.0, before, after)


class Converged(NamedTuple):
    """The image and the next history."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: RestHistory
    frozen: Tensor  # (1, 1, H, W) 1 where the image is frozen, else 0


def compare(frame: RestFrame, history: RestHistory, previous: Size, display: Size) -> StaticBlocks:
    """Compare each block with its signature of this phase.

    Args:
        frame: this frame.
        history: history of the previous frame.
        previous: render size of the previous frame.
        display: (width, height) of the image.
    """
    render = size_of(frame.color)
    history = of_frame(history, previous, display, render)
    cycle = follow_jitter(frame, history.phases)
    sampled, noisy = frame.is_sampled, frame.is_noisy
    usable, color = valid(frame.color), sanitize(frame.color, 0.0)
    before, tests = history.blocks.split_with_sizes([1, 3], dim=1)
    age, was_frozen = before.abs(), (before < 0.0).float()
    known = (cycle.age > 0.0).float() * (cycle.age <= age).float() * (sampled - noisy)
    signature = signatures_of(color * usable)
    reference = history.signatures.index_select(0, cycle.slot)
    small, large = residuals_of(color, usable, history.mean, frame.jitter, age)
    drift = tests + spec.NOISE_RATE * (small.residuals / (small.level + spec.DARK / frame.exposure) - tests)
    drift = drift * (small.samples > 0.0)

    changed = torch.maximum(
        differing(signature, reference, frame.exposure) * known,
        drifting(drift, small, frame.exposure) * noisy,
    )
    restarts = widened(torch.maximum(changed, was_frozen * (1.0 - known) * sampled))
    limit = spec.MAX_STATIC_MOTION * spec.MAX_STATIC_MOTION
    moving = (squared_length(usable_motion(frame.motion)) > limit).float()
    moving = torch.maximum(moving, (frame.reactive > 0.0).float())
    moves = widened(F.max_pool2d(to_blocks(moving), BLOCK))
    static = (1.0 - moves) * (1.0 - restarts)
    verifies = known * static * cycle.counts * (1.0 - was_frozen)
    confirmed = torch.where(
        cycle.counts > 0.0, verifies * (tests + steadiness(small, large, frame.exposure)), tests * static
    )
    kept = torch.maximum(known * static, 1.0 - cycle.counts) > 0.0  # without a new phase, its signature stays
    signatures = write_slot(history.signatures, cycle.slot, torch.where(kept, reference, signature))
    return StaticBlocks(
        known=known,
        moves=moves,
        static=static,
        adds=cycle.counts * (1.0 - moves) * torch.maximum(restarts, 1.0 - known),
        stays=was_frozen * static,
        age=((age * static + cycle.counts) * (1.0 - moves)).clamp(max=spec.OLDEST),
        verifies=verifies,
        tests=torch.where(noisy > 0.0, drift * static, confirmed),
        history=history._replace(signatures=signatures, phases=cycle.phases),
        cycle=cycle,
        at_pixels=BlocksAtPixels(display, render, size_of(age)),
    )


def converge(image: Tensor, frame: RestFrame, blocks: StaticBlocks, grid: Grid) -> Converged:
    """Fade the method's image to the mean of the samples where nothing changes, and freeze it there.

    The image is (1, 3, H, W) linear RGB; the grid may extend beyond it.
    """
    display, render = size_of(image), size_of(frame.color)
    usable, color = valid(frame.color), sanitize(frame.color, 0.0)
    noisy = frame.is_noisy
    history, cycle, pick = blocks.history, blocks.cycle, blocks.at_pixels.pick
    mean = add_samples(history.mean, color, usable, pick(blocks.static), pick(blocks.adds), grid, display)
    steady = (blocks.tests.amax(dim=1, keepdim=True) <= 0.0).float() * blocks.static
    periods = blocks.age / cycle.period.clamp(min=1.0) * (cycle.period > 0.0)
    fade = ((periods - spec.SHOWN_FROM) / (spec.SHOWN - spec.SHOWN_FROM)).clamp(0.0, 1.0)
    fade = fade * steady * (1.0 - blocks.adds)

    enough = (mean[:, 3:] >= spec.LEAST_WEIGHT).float()
    complete = pick(torch.maximum(blocks.stays, (periods >= 1.0).float())) * enough * (1.0 - noisy)
    centred = at_centres(mean[:, :3], complete, offsets_of(cycle, display, render))
    of_noise = (mean[:, 3:] / spec.NOISE_WEIGHT - 1.0).clamp(0.0, 1.0)
    share = torch.where(noisy > 0.0, of_noise, pick(fade) * enough)
    shown = bounded(image + share * (centred - image))
    shown = torch.where(pick(blocks.stays) > 0.0, mean[:, :3], shown)

    due = blocks.verifies * (periods >= 2.0).float()
    freezes = due * steady * blocks.at_pixels.minimum(enough)
    frozen, retries = torch.maximum(blocks.stays, freezes), due * (1.0 - freezes)
    age = torch.where(retries > 0.0, cycle.period, blocks.age) * (1.0 - 2.0 * frozen)
    next_blocks = torch.cat([age, blocks.tests * (1.0 - due)], dim=1)
    frozen_pixels = pick(frozen)
    mean = torch.cat([torch.where(frozen_pixels > 0.0, shown, mean[:, :3]), mean[:, 3:]], dim=1)
    return Converged(shown, history._replace(mean=mean, blocks=next_blocks), frozen_pixels)


def kept(resting: Tensor, before: Tensor, after: Tensor) -> Tensor:
    """Return a method's own next history, (1, c, H, W): unchanged in resting tiles."""
    return torch.where(resting > 0.0, before, after)


def of_frame(history: RestHistory, previous: Size, display: Size, render: Size) -> RestHistory:
    """Return the history in the sizes of this frame; zeros if the render size changed."""
    one = history.phases.new_ones(1)
    same = ((one * previous.width == render.width) & (one * previous.height == render.height)).float()
    across, down = ((extent + BLOCK - 1) // BLOCK for extent in render)
    phases = spec.PHASES_PER_SAMPLE * display.width * display.height // (render.width * render.height)
    count = phases + spec.SPARE_PHASES
    blocks = fit(history.blocks, across, down) * same
    signatures = fit(fit_axis(history.signatures, 0, count), across, down)
    return RestHistory(history.mean * same, blocks, signatures, fit_axis(history.phases, 0, count) * same)


def follow_jitter(frame: RestFrame, phases: Tensor) -> Cycle:
    """Find the row of the frame's jitter among the phases; a new jitter takes a free or the oldest row."""
    ages, periods, oldest = phases[:, 2], phases[:, 3], spec.OLDEST
    row = torch.arange(phases.shape[0], device=phases.device)
    same = ((phases[:, :2] - frame.jitter).abs().sum(dim=1) < 1e-6) & (ages > 0.0)
    rank = torch.where(same, 4.0 * oldest, torch.where(ages > 0.0, ages, 2.0 * oldest)) - row
    first = torch.where(rank == rank.amax(dim=0, keepdim=True), -row.float(), -oldest)  # of equal ranks
    slot = (-first.amax(dim=0, keepdim=True)).long()
    here = row == slot
    age = (ages * (same & here)).sum().reshape(1)
    latest = (periods * (ages == 1.0)).sum().reshape(1)
    counts = frame.is_sampled * torch.maximum((age != 1.0).float(), frame.is_noisy)
    period = torch.where((age > 0.0) & (counts > 0.0), age, latest)
    older = (ages + counts * (ages > 0.0)).clamp(max=oldest)
    fresh = torch.cat([frame.jitter[0], frame.jitter.new_ones(1), period])
    written = (here.float() * counts)[:, None]
    table = torch.cat([phases[:, :2], older[:, None], periods[:, None]], dim=1)
    return Cycle(slot, age, period, counts, table * (1.0 - written) + fresh * written)


def signatures_of(color: Tensor) -> Tensor:
    """Return the signatures of blocks, (1, 4, hb, wb): three means, and a sum that depends on the order."""
    roots, samples = color.sqrt().sqrt(), BLOCK * BLOCK
    means = torch.eye(3)[:, :, None, None].expand(3, 3, BLOCK, BLOCK) / samples
    order = (spec.ORDER_FACTOR * torch.arange(3 * samples) ** 3 % spec.ORDER_PRIME).float()
    order = (2.0 * order / (spec.ORDER_PRIME - 1.0) - 1.0).reshape(1, 3, BLOCK, BLOCK) / samples
    return F.conv2d(to_blocks(roots), torch.cat([means, order]).to(roots.device), stride=BLOCK)


def to_blocks(image: Tensor) -> Tensor:
    """Repeat the last row and column, so that the blocks at the edges are complete."""
    return fit(image, image.shape[3] + BLOCK - 1, image.shape[2] + BLOCK - 1)


def differing(signature: Tensor, reference: Tensor, exposure: Tensor) -> Tensor:
    """Return (1, 1, hb, wb): 1 where two signatures differ, else 0."""
    level = torch.maximum(signature[:, :3], reference[:, :3]).amax(dim=1, keepdim=True)
    level = torch.maximum(level, (spec.DARK / exposure) ** 0.25)
    return ((signature - reference).abs().amax(dim=1, keepdim=True) > spec.TOLERANCE * level).float()


def widened(blocks: Tensor) -> Tensor:
    """Return the maximum over 3x3 blocks: pixels at a block's border have samples of the next block."""
    return F.max_pool2d(blocks, 3, 1, 1)


def write_slot(signatures: Tensor, slot: Tensor, signature: Tensor) -> Tensor:
    """Return the signatures of all phases, with one replaced."""
    row = torch.arange(signatures.shape[0], device=slot.device)
    return torch.where((row == slot)[:, None, None, None], signature, signatures)


class BlocksAtPixels:
    """Index of each display pixel's block, and of the pixel nearest to the centre of each sample."""

    def __init__(self, display: Size, render: Size, blocks: Size) -> None:
        self._render, self._blocks = render, blocks
        self._columns, self._rows = (
            ((2.0 * torch.arange(full) + 1.0) * size / (2 * BLOCK * full)).floor().long().clamp(max=count - 1)
            for full, size, count in zip(display, render, blocks, strict=True)
        )
        self._sample_columns, self._sample_rows = (
            ((2.0 * torch.arange(size) + 1.0) * full / (2 * size)).floor().long().clamp(max=full - 1)
            for full, size in zip(display, render, strict=True)
        )

    def resized(self, display: Size) -> "BlocksAtPixels":
        """Return the blocks at the pixels of an image of another size."""
        return BlocksAtPixels(display, self._render, self._blocks)

    def pick(self, blocks: Tensor) -> Tensor:
        """Read the block of each display pixel: (1, 1, hb, wb) -> (1, 1, H, W)."""
        columns, rows = self._columns.to(blocks.device), self._rows.to(blocks.device)
        return pick_columns(blocks, columns).index_select(2, rows)

    def nearest(self, step: int) -> tuple[Tensor, Tensor]:
        """Return columns and rows of the pixels nearest to every `step`-th sample of an axis, int64."""
        return self._sample_columns[::step], self._sample_rows[::step]

    def minimum(self, pixels: Tensor) -> Tensor:
        """Return the minimum at the centres of each block's samples: (1, 1, H, W) -> (1, 1, hb, wb)."""
        columns, rows = self._sample_columns.to(pixels.device), self._sample_rows.to(pixels.device)
        return -F.max_pool2d(to_blocks(-pick_columns(pixels, columns).index_select(2, rows)), BLOCK)


def trapezoid(distance: Tensor) -> Tensor:
    """Return the weight of a sample in the mean, by its distance in display pixels along one axis."""
    return ((spec.OUTER - distance.abs()) / (spec.OUTER - spec.INNER)).clamp(0.0, 1.0)


def add_samples(
    mean: Tensor, color: Tensor, usable: Tensor, static: Tensor, adds: Tensor, grid: Grid, display: Size
) -> Tensor:
    """Add the samples near each pixel to the mean, (1, 4, H, W), or restart it with them."""
    render = size_of(color)
    ratio = display.width / render.width, display.height / render.height

    def cut(axis: Bands, extent: int) -> Bands:
        return axis._replace(outputs=extent)

    across, down = map(cut, grid.bands(render, trapezoid, reach=1, scale=ratio, inside=True), display)
    near = resample(torch.cat([color * usable, usable], dim=1), across, down) * adds
    weight = mean[:, 3:] * static
    total = weight + near[:, 3:]
    colors = mean[:, :3] * weight + near[:, :3]
    colors = torch.where(near[:, 3:] > 0.0, colors / total.clamp(min=1e-6), mean[:, :3])
    return torch.cat([colors, total], dim=1)


def offsets_of(cycle: Cycle, display: Size, render: Size) -> tuple[Tensor, Tensor]:
    """Return mean offsets of a period's samples from each pixel's centre: x and y, (H, W), display pixels."""
    ages = cycle.phases[:, 2]
    used = ((ages > 0.0) & (ages <= cycle.period)).float()
    (gx, dx), (gy, dy) = (_moments(cycle.phases[:, axis], display[axis], render[axis]) for axis in (0, 1))
    gx, dx = gx * used[:, None], dx * used[:, None]
    weight = (gy.T @ gx).clamp(min=1e-6)
    return gy.T @ dx / weight, dy.T @ gx / weight


def _moments(jitter: Tensor, display: int, render: int) -> tuple[Tensor, Tensor]:
    """Return the sums of the weights of the samples near each pixel of an axis, and of weights times offsets.

    Both are (phases, n).
    """
    pixel = torch.arange(display, device=jitter.device)
    place = (pixel + 0.5) * render / display - 0.5 - jitter[:, None]
    sample = place.floor()[:, :, None] + torch.arange(2, device=jitter.device)
    offset = (sample - place[:, :, None]) * display / render
    weight = trapezoid(offset) * ((sample >= 0.0) & (sample <= render - 1.0))
    return weight.sum(dim=2), (weight * offset).sum(dim=2)


def at_centres(mean: Tensor, complete: Tensor, offsets: tuple[Tensor, Tensor]) -> Tensor:
    """Move a mean from the mean position of its samples to the pixel's centre, along its slope.

    The slope is the central difference, limited to twice the smaller one-sided difference (van Leer 1977).
    Ringing at edges is therefore impossible. The slope is 0 where a neighbour is not complete.
    """
    moved = torch.zeros_like(mean)
    for axis, offset in zip((3, 2), offsets, strict=True):
        before, after = neighbours(mean, axis)
        has_before, has_after = neighbours(complete, axis)
        below, above = mean - before, after - mean
        limit = 2.0 * torch.minimum(below.abs(), above.abs()) * has_before * has_after
        slope = torch.maximum(torch.minimum(0.5 * (below + above), limit), -limit)
        moved = moved + slope * offset
    return (mean - moved).clamp(min=0.0)


def neighbours(image: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """Return the pixels before and after each along an axis; edges are repeated."""
    index, last = torch.arange(image.shape[axis], device=image.device), image.shape[axis] - 1
    before, after = (index - 1).clamp(min=0), (index + 1).clamp(max=last)
    return image.index_select(axis, before), image.index_select(axis, after)


class WindowMoments(NamedTuple):
    """Moments over the window of each block, (1, 1, hb, wb)."""

    samples: Tensor  # number of samples
    level: Tensor  # largest channel of the mean
    residuals: Tensor  # (1, 3, hb, wb) mean of the samples less the mean that is expected there
    variance: Tensor  # of the residuals, summed over channels
    contrast: Tensor  # variance of the samples

    @property
    def square(self) -> Tensor:
        """Squared mean residual, summed over channels."""
        return self.residuals.square().sum(dim=1, keepdim=True)


def residuals_of(
    color: Tensor, usable: Tensor, mean: Tensor, jitter: Tensor, blocks: Tensor
) -> tuple[WindowMoments, WindowMoments]:
    """Compare the samples with the mean, in the small and the large windows.

    Args:
        color: (1, 3, h, w) linear RGB.
        usable: (1, 1, h, w) 1 where a sample counts.
        mean: (1, 4, H, W) the mean, and the sum of its weights.
        jitter: (1, 2) of the frame.
        blocks: (1, 1, hb, wb) any image of this size.
    """
    enough = (mean[:, 3:] >= spec.LEAST_WEIGHT).float()
    expected = at_samples(torch.cat([mean[:, :3], enough], dim=1), size_of(color), jitter)
    expected, enough = expected.split_with_sizes([3, 1], dim=1)
    counted = usable * (enough > FULL_WEIGHT)
    difference = (color - expected) * counted
    squares = [(part * part).sum(dim=1, keepdim=True) for part in (difference, color * counted)]
    values = torch.cat([counted, difference, color * counted, expected * counted, *squares], dim=1)
    sums, size = images.block_means(to_blocks(values), BLOCK), size_of(blocks)
    small, large = (moments_of(sums, side, size) for side in WINDOWS)
    return small, large


def moments_of(sums: Tensor, side: int, size: Size) -> WindowMoments:
    """Average the planes of `residuals_of` over windows of `side` blocks."""
    parts = images.window_means(sums, side, size).split_with_sizes([1, 3, 3, 3, 1, 1], dim=1)
    count, difference, color, expected, square, color_square = parts
    share = 1.0 / count.clamp(min=1e-6)
    residuals = difference * share
    return WindowMoments(
        count * (side * BLOCK) ** 2,
        (expected * share).amax(dim=1, keepdim=True),
        residuals,
        (square * share - residuals.square().sum(dim=1, keepdim=True)).clamp(min=0.0),
        (color_square * share - (color * share).square().sum(dim=1, keepdim=True)).clamp(min=0.0),
    )


def steadiness(small: WindowMoments, large: WindowMoments, exposure: Tensor) -> Tensor:
    """Return the excess of residuals over UNIFORM, COMMON and UNRESOLVED, (1, 3, hb, wb); <= 0 is steady.

    Beside a window above UNIFORM the limit is PARTIAL, because changed light reaches into adjacent windows.
    """
    uniform = excess(small.square, small.variance, spec.UNIFORM, small, exposure)
    partial = excess(small.square, small.variance, spec.PARTIAL, small, exposure)
    sparkling = (small.contrast - spec.SPARKLING * small.level.square()).clamp(min=0.0)
    contrast = small.contrast + spec.BESIDE * with_windows_around(small.contrast)
    explained = contrast + (1.0 / spec.UNRESOLVED - 1.0) * sparkling
    tests = [
        torch.minimum(with_windows_around(uniform), partial),
        excess(large.square, large.variance, spec.COMMON, large, exposure),
        excess(small.variance, explained, spec.UNRESOLVED, small, exposure),
    ]
    return torch.cat(tests, dim=1)


def with_windows_around(blocks: Tensor) -> Tensor:
    """Return the maximum over the small window of each block and the eight windows around it."""
    return F.max_pool2d(blocks, 2 * WINDOWS[0] + 1, 1, WINDOWS[0])


def excess(square: Tensor, variance: Tensor, ratio: float, window: WindowMoments, exposure: Tensor) -> Tensor:
    """Return (square - ratio variance) / level^2 - FLICKER^2: an excess relative to the light."""
    level = window.level + spec.DARK / exposure
    relative = (square - ratio * variance) / (level * level)
    return (relative - spec.FLICKER * spec.FLICKER).clamp(-spec.OLDEST, spec.OLDEST)


def drifting(drift: Tensor, window: WindowMoments, exposure: Tensor) -> Tensor:
    """Return (1, 1, hb, wb): 1 where a running mean of relative residuals exceeds its noise, else 0."""
    level = window.level + spec.DARK / exposure
    frames = spec.NOISE_RATE / (2.0 - spec.NOISE_RATE)  # variance of the running mean over that of a frame
    noise = (window.variance * frames / window.samples.clamp(min=1.0)).sqrt() / level
    limit = spec.NOISE_FLICKER + spec.NOISE_SIGMAS * noise
    return (drift.abs().amax(dim=1, keepdim=True) > limit).float()


def at_samples(image: Tensor, render: Size, jitter: Tensor) -> Tensor:
    """Read an image of the display bilinearly at the samples: (1, c, H, W) -> (1, c, h, w)."""
    display = size_of(image)
    columns = sample_positions(render.width, display.width, jitter[0, :1])
    rows = sample_positions(render.height, display.height, jitter[0, 1:])
    return interpolated_rows(interpolated_rows(image.transpose(2, 3), columns).transpose(2, 3), rows)


def interpolated_rows(image: Tensor, position: Tensor) -> Tensor:
    """Interpolate linearly between rows, clamped at the border: (1, c, h, w) -> (1, c, n, w)."""
    size, whole = image.shape[2], position.floor()
    first = whole.long()
    before, after = (image.index_select(2, index.clamp(0, size - 1)) for index in (first, first + 1))
    return before + (position - whole)[:, None] * (after - before)


def sample_positions(render: int, display: int, jitter: Tensor) -> Tensor:
    """Return the positions of an axis' samples, (render,) display pixels; 0 is the first pixel's centre."""
    sample = torch.arange(render, dtype=torch.float32, device=jitter.device)
    return (sample + 0.5 + jitter) * display / render - 0.5
