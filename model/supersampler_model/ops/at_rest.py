"""What stands still: the mean of one jitter period of samples, shown once another period has confirmed it.

A method keeps its own image. Beside it, the samples of each phase of the jitter are added once to a mean: its
weights, its jitter and its light are then those of exactly one period. Nothing is shown of it until the samples
have come again, phase by phase, as they were one period before. Only what is the same twice is known to stand
still, whatever moves, fades or flickers.

The frame is divided into blocks of 4x4 samples. Each has a signature for each phase: the means of the fourth
roots of its samples, and a weighted sum of them that depends on their order. A signature is written once and
never updated, so that slow changes add up. A block restarts, with its neighbours, where a signature differs or
something moves. So light that fades, jumps or flickers, an edge that creeps, a screen that scrolls and a camera
that moves less than can be seen show the method's own image.

What repeats with the jitter itself would pass this test: light that blinks with a divisor of its period. So
residuals of the samples from the mean are compared over the period, too. Aliasing averages out over a window
of samples, light does not: a block is not shown where the window's mean residual is large for the variance in
it (UNIFORM in 8x8 samples, COMMON in 32x32), or where the mean says nothing of the samples (UNRESOLVED).

A block that has been confirmed for a whole period is frozen: its image is the mean, bit by bit, and no sample
is added. In a tile of the display whose blocks are all frozen, the method's own history is kept as it is. A
backend may therefore leave out the method there.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.at_rest import (
    BLOCK,
    COMMON,
    DARK,
    FLICKER,
    INNER,
    LEAST_WEIGHT,
    MAX_STATIC_MOTION,
    OUTER,
    PHASES_PER_SAMPLE,
    SHOWN,
    SHOWN_FROM,
    SPARKLING,
    SPARE_PHASES,
    TILE,
    TOLERANCE,
    UNIFORM,
    UNRESOLVED,
    WINDOWS,
)
from supersampler_model.ops.color import bounded, sanitize, valid
from supersampler_model.ops.motion import squared_length, usable_motion
from supersampler_model.ops.sampling import Grid, grid_bands, pick_columns, resample
from supersampler_model.ops.size import Size, render_size_of

COVERED = 0.999  # of four bilinear weights
OLDEST = float(1 << 20)
"""Limit of counted frames: float32 counts on exactly."""


class RestFrame(NamedTuple):
    """This frame, at render size."""

    color: Tensor  # (1, 3, h, w) linear RGB as given: any value
    motion: Tensor  # (1, 2, h, w) render pixels
    jitter: Tensor  # (1, 2) render pixels
    exposure: Tensor  # (1,) > 0
    adds_samples: Tensor  # (1,) 0 where `color` was not sampled in this frame


class RestHistory(NamedTuple):
    """The history tensors of `AT_REST_HISTORY`; zeros without a history."""

    mean: Tensor  # (1, 4, H, W) linear RGB, and the sum of weights
    blocks: Tensor  # (1, 4, hb, wb) age, negative where frozen; sums of the tests UNIFORM, COMMON, UNRESOLVED
    signatures: Tensor  # (phases, 4, hb, wb)
    phases: Tensor  # (phases, 4) jitter x and y, frames since it was seen, frames between its last two


class Rested(NamedTuple):
    """The image and the next history."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: RestHistory
    frozen: Tensor  # (1, 1, H, W) 1 where the image is frozen, else 0
    resting: Tensor  # (1, 1, H, W) 1 in tiles where the method's own history is kept


class Cycle(NamedTuple):
    """The jitter of this frame, and when it was last seen."""

    slot: Tensor  # (1,) int64, its row in `phases`
    age: Tensor  # (1,) frames since it was last seen; 0 if it is new
    period: Tensor  # (1,) frames of a jitter period; 0 while it is unknown
    counts: Tensor  # (1,) 1 where the frame adds a phase: 0 after a frame of the same jitter, or without samples
    phases: Tensor  # (phases, 4) the next table


def converge(image: Tensor, frame: RestFrame, history: RestHistory, previous: Size, grid: Grid) -> Rested:
    """Fade the image to the mean of the samples where nothing changes, and freeze it there.

    Args:
        image: (1, 3, H, W) the method's, linear RGB.
        frame: this frame.
        history: of the previous frame.
        previous: render size of the previous frame.
        grid: of the frame; it may extend beyond the image.
    """
    display, render = render_size_of(image), render_size_of(frame.color)
    usable, color = valid(frame.color), sanitize(frame.color, 0.0)
    history = of_frame(history, previous, display, render)
    cycle = follow_jitter(frame, history.phases)
    sampled = (frame.adds_samples > 0.0).float()

    age, was_frozen = history.blocks[:, :1].abs(), (history.blocks[:, :1] < 0.0).float()
    known = (cycle.age > 0.0).float() * (cycle.age <= age).float() * sampled
    signature = signatures_of(color * usable)
    reference = history.signatures.index_select(0, cycle.slot)
    changed = differing(signature, reference, frame.exposure) * known
    moving = (squared_length(usable_motion(frame.motion)) > MAX_STATIC_MOTION * MAX_STATIC_MOTION).float()
    moves = widened(F.max_pool2d(to_blocks(moving), BLOCK))
    restarts = widened(torch.maximum(changed, was_frozen * (1.0 - known) * sampled))
    stands = (1.0 - moves) * (1.0 - restarts)
    adds = cycle.counts * (1.0 - moves) * torch.maximum(restarts, 1.0 - known)
    signatures = write_slot(history.signatures, cycle.slot, torch.where(known * stands > 0.0, reference, signature))

    at_pixels = BlocksAtPixels(display, render, render_size_of(age), image.device)
    mean = add_samples(history.mean, color, usable, at_pixels.pick(stands), at_pixels.pick(adds), grid, display)
    verifies = known * stands * cycle.counts * (1.0 - was_frozen)
    tests = history.blocks[:, 1:] * verifies + verifies * test_residuals(color, usable, mean, frame, age)
    age = ((age * stands + cycle.counts) * (1.0 - moves)).clamp(max=OLDEST)
    periods = age / cycle.period.clamp(min=1.0) * (cycle.period > 0.0)
    steady = (tests.amax(dim=1, keepdim=True) <= 0.0).float() * stands
    fade = ((periods - SHOWN_FROM) / (SHOWN - SHOWN_FROM)).clamp(0.0, 1.0) * steady * (1.0 - adds)
    enough = (mean[:, 3:] >= LEAST_WEIGHT).float()
    share = at_pixels.pick(fade) * enough

    complete = at_pixels.pick(torch.maximum(was_frozen, (periods >= 1.0).float())) * enough
    corrected = at_centres(mean[:, :3], complete, offsets_of(cycle, grid, display, render))
    stays = at_pixels.pick(was_frozen * stands)
    shown = torch.where(stays > 0.0, mean[:, :3], bounded(image + share * (corrected - image)))

    due = verifies * (periods >= 2.0).float()
    freezes = due * steady * at_pixels.least(enough)
    frozen = torch.maximum(was_frozen * stands, freezes)
    retries = due * (1.0 - freezes)
    age = torch.where(retries > 0.0, cycle.period, age) * (1.0 - 2.0 * frozen)
    tests = tests * (1.0 - retries) * (1.0 - frozen)
    frozen_pixels = at_pixels.pick(frozen)
    mean = torch.cat([torch.where(frozen_pixels > 0.0, shown, mean[:, :3]), mean[:, 3:]], dim=1)
    next_history = RestHistory(mean, torch.cat([age, tests], dim=1), signatures, cycle.phases)
    return Rested(shown, next_history, frozen_pixels, whole_tiles(stays))


def of_frame(history: RestHistory, previous: Size, display: Size, render: Size) -> RestHistory:
    """Return the history, of the sizes of this frame; zeros for what was of another size."""
    one = history.phases.new_ones(1)
    same = ((one * previous.width == render.width) & (one * previous.height == render.height)).float()
    across, down = ((extent + BLOCK - 1) // BLOCK for extent in render)
    count = PHASES_PER_SAMPLE * display.width * display.height // (render.width * render.height) + SPARE_PHASES
    blocks = cut(cut(history.blocks, 2, down), 3, across) * same
    signatures = cut(cut(cut(history.signatures, 0, count), 2, down), 3, across)
    return RestHistory(history.mean, blocks, signatures, cut(history.phases, 0, count) * same)


def cut(tensor: Tensor, axis: int, extent: int) -> Tensor:
    """Return the tensor with another extent along an axis: cut, or its last entry repeated."""
    index = torch.arange(extent, device=tensor.device).clamp(max=tensor.shape[axis] - 1)
    return tensor.index_select(axis, index)


def follow_jitter(frame: RestFrame, phases: Tensor) -> Cycle:
    """Find the frame's jitter in the table of phases, or give it the row that was not used for longest."""
    ages, periods = phases[:, 2], phases[:, 3]
    row = torch.arange(phases.shape[0], device=phases.device)
    same = ((phases[:, :2] - frame.jitter).abs().sum(dim=1) < 1e-6) & (ages > 0.0)
    rank = torch.where(same, 4.0 * OLDEST, torch.where(ages > 0.0, ages, 2.0 * OLDEST)) - row
    here = rank == rank.max()
    age = (ages * (same & here)).sum().reshape(1)
    latest = (periods * (ages == 1.0)).sum().reshape(1)
    sampled = (frame.adds_samples > 0.0).float()
    counts = sampled * (age != 1.0).float()
    period = torch.where((age > 0.0) & (counts > 0.0), age, latest)
    older = (ages + counts * (ages > 0.0)).clamp(max=OLDEST)
    fresh = torch.cat([frame.jitter[0], frame.jitter.new_ones(1), period])
    written = (here.float() * counts)[:, None]
    table = torch.cat([phases[:, :2], older[:, None], periods[:, None]], dim=1)
    slot = (here * row).sum().reshape(1)
    return Cycle(slot, age, period, counts, table * (1.0 - written) + fresh * written)


def signatures_of(color: Tensor) -> Tensor:
    """(1, 4, hb, wb) signatures of blocks of samples: three means, and a sum that depends on their order."""
    roots = color.sqrt().sqrt()
    return F.conv2d(to_blocks(roots), _signature_weights(roots.device), stride=BLOCK)


def _signature_weights(device: torch.device) -> Tensor:
    """(4, 3, BLOCK, BLOCK) weights of the samples of a block."""
    samples = BLOCK * BLOCK
    means = torch.eye(3)[:, :, None, None].expand(3, 3, BLOCK, BLOCK) / samples
    order = torch.arange(3 * samples, dtype=torch.float32) * 0.7548776662466927  # of the plastic number
    return torch.cat([means, (2.0 * (order - order.floor()) - 1.0).reshape(1, 3, BLOCK, BLOCK) / samples]).to(device)


def to_blocks(image: Tensor) -> Tensor:
    """Repeat the last row and column, so that blocks at the edges are whole."""
    return F.pad(image, (0, BLOCK - 1, 0, BLOCK - 1), mode="replicate")


def differing(signature: Tensor, reference: Tensor, exposure: Tensor) -> Tensor:
    """(1, 1, hb, wb) 1 where two signatures differ, else 0."""
    level = torch.maximum(signature[:, :3], reference[:, :3]).amax(dim=1, keepdim=True)
    level = torch.maximum(level, (DARK / exposure) ** 0.25)
    return ((signature - reference).abs().amax(dim=1, keepdim=True) > TOLERANCE * level).float()


def widened(blocks: Tensor) -> Tensor:
    """Maximum over 3x3 blocks: a pixel near the border of a block has samples of its neighbour."""
    return F.max_pool2d(blocks, 3, 1, 1)


def write_slot(signatures: Tensor, slot: Tensor, signature: Tensor) -> Tensor:
    """Return the signatures of all phases, with one replaced."""
    row = torch.arange(signatures.shape[0], device=slot.device)
    return torch.where((row == slot)[:, None, None, None], signature, signatures)


class BlocksAtPixels:
    """Which block each display pixel is of, and the pixel nearest to the centre of each sample."""

    def __init__(self, display: Size, render: Size, blocks: Size, device: torch.device) -> None:
        self._display = display
        self._columns, self._rows = (
            ((2 * torch.arange(full, device=device) + 1) * size // (2 * full * BLOCK)).clamp(max=count - 1)
            for full, size, count in zip(display, render, blocks, strict=True)
        )
        self._sample_columns, self._sample_rows = (
            ((2 * torch.arange(size, device=device) + 1) * full // (2 * size)).clamp(max=full - 1)
            for full, size in zip(display, render, strict=True)
        )

    def pick(self, blocks: Tensor) -> Tensor:
        """Read the block of each display pixel: (1, 1, hb, wb) -> (1, 1, H, W)."""
        return pick_columns(blocks, self._columns).index_select(2, self._rows)

    def least(self, pixels: Tensor) -> Tensor:
        """Minimum over each block, of the pixels at the centres of its samples: (1, 1, H, W) -> (1, 1, hb, wb)."""
        samples = pick_columns(pixels, self._sample_columns).index_select(2, self._sample_rows)
        return -F.max_pool2d(to_blocks(-samples), BLOCK)


def trapezoid(distance: Tensor) -> Tensor:
    """Weight of a sample in the mean, by its distance in display pixels along one axis."""
    return ((OUTER - distance.abs()) / (OUTER - INNER)).clamp(0.0, 1.0)


def add_samples(
    mean: Tensor, color: Tensor, usable: Tensor, stands: Tensor, adds: Tensor, grid: Grid, display: Size
) -> Tensor:
    """Add the samples near each pixel to the mean, (1, 4, H, W), or restart it with them."""
    render = render_size_of(color)
    ratio = display.width / render.width, display.height / render.height
    across, down = (
        axis._replace(outputs=extent)
        for axis, extent in zip(
            grid_bands(grid, render, trapezoid, reach=1, scale=ratio, inside=True), display, strict=True
        )
    )
    near = resample(torch.cat([color * usable, usable], dim=1), across, down) * adds
    weight = mean[:, 3:] * stands
    total = weight + near[:, 3:]
    colors = mean[:, :3] * weight + near[:, :3]
    colors = torch.where(near[:, 3:] > 0.0, colors / total.clamp(min=1e-6), mean[:, :3])
    return torch.cat([colors, total], dim=1)


def offsets_of(cycle: Cycle, grid: Grid, display: Size, render: Size) -> tuple[Tensor, Tensor]:
    """Mean offsets (H, W) of the samples of a period from each pixel's centre, x and y, display pixels."""
    ages = cycle.phases[:, 2]
    used = ((ages > 0.0) & (ages <= cycle.period)).float()
    (gx, dx), (gy, dy) = (
        _moments(cycle.phases[:, axis], display[axis], render[axis]) for axis in (0, 1)
    )
    gx, dx = gx * used[:, None], dx * used[:, None]
    weight = (gy.T @ gx).clamp(min=1e-6)
    return gy.T @ dx / weight, dy.T @ gx / weight


def _moments(jitter: Tensor, display: int, render: int) -> tuple[Tensor, Tensor]:
    """(phases, n) weights of the samples near the pixels of an axis in each phase, and these times offsets."""
    pixel = torch.arange(display, device=jitter.device)
    place = (pixel + 0.5) * render / display - 0.5 - jitter[:, None]
    sample = place.floor()[:, :, None] + torch.arange(2, device=jitter.device)
    offset = (sample - place[:, :, None]) * display / render
    weight = trapezoid(offset) * ((sample >= 0.0) & (sample <= render - 1.0))
    return weight.sum(dim=2), (weight * offset).sum(dim=2)


def at_centres(mean: Tensor, complete: Tensor, offsets: tuple[Tensor, Tensor]) -> Tensor:
    """Move a mean from the mean place of its samples to the pixel's centre, along its slope.

    The slope is that between the neighbours, at most twice the smaller of those to each neighbour: none at
    edges and on thin lines. Where a neighbour is not complete, it is none.
    """
    for axis, offset in zip((3, 2), offsets, strict=True):
        before, after = neighbours(mean, axis)
        has_before, has_after = neighbours(complete, axis)
        below, above = mean - before, after - mean
        most = 2.0 * torch.minimum(below.abs(), above.abs()) * has_before * has_after
        slope = torch.maximum(torch.minimum(0.5 * (below + above), most), -most)
        moved = slope * offset if axis == 3 else moved + slope * offset
    return (mean - moved).clamp(min=0.0)


def neighbours(image: Tensor, axis: int) -> tuple[Tensor, Tensor]:
    """The pixels before and after each along an axis; edges are repeated."""
    index, last = torch.arange(image.shape[axis], device=image.device), image.shape[axis] - 1
    return image.index_select(axis, (index - 1).clamp(min=0)), image.index_select(axis, (index + 1).clamp(max=last))


def test_residuals(color: Tensor, usable: Tensor, mean: Tensor, frame: RestFrame, blocks: Tensor) -> Tensor:
    """(1, 3, hb, wb) how far the residuals of this frame's samples are over UNIFORM, COMMON and UNRESOLVED.

    Args:
        color: (1, 3, h, w) linear RGB.
        usable: (1, 1, h, w) 1 where a sample counts.
        mean: (1, 4, H, W) the mean, and the sum of its weights.
        frame: this frame.
        blocks: (1, 1, hb, wb) any image of this size.
    """
    known = (mean[:, 3:] >= LEAST_WEIGHT).float()
    expected, known = at_samples(
        torch.cat([mean[:, :3], known], dim=1), render_size_of(color), frame.jitter
    ).split_with_sizes([3, 1], dim=1)
    counted = usable * (known > COVERED)
    difference = (color - expected) * counted
    squares = [(part * part).sum(dim=1, keepdim=True) for part in (difference, color * counted)]
    values = torch.cat([counted, difference, color * counted, expected * counted, *squares], dim=1)
    sums, size = F.avg_pool2d(to_blocks(values), BLOCK), render_size_of(blocks)
    small, large = (windows_of(sums, side, size) for side in WINDOWS)
    sparkling = (small.contrast - SPARKLING * small.level.square()).clamp(min=0.0)
    explained = small.contrast + (1.0 / UNRESOLVED - 1.0) * sparkling
    tests = [
        excess(small.residual, small.variance, UNIFORM, small, frame.exposure),
        excess(large.residual, large.variance, COMMON, large, frame.exposure),
        excess(small.variance, explained, UNRESOLVED, small, frame.exposure),
    ]
    return torch.cat(tests, dim=1)


class Windows(NamedTuple):
    """Moments over the window of each block, (1, 1, hb, wb)."""

    level: Tensor  # largest channel of the mean
    residual: Tensor  # squared mean residual, summed over channels
    variance: Tensor  # of the residuals
    contrast: Tensor  # variance of the samples


def windows_of(sums: Tensor, side: int, size: Size) -> Windows:
    """Average the sums of blocks over windows of `side` blocks; see `test_residuals`."""
    pooled = F.avg_pool2d(F.pad(sums, (0, side - 1, 0, side - 1)), side)
    for axis, extent in ((3, size.width), (2, size.height)):
        pooled = pooled.index_select(axis, torch.arange(extent, device=sums.device) // side)
    count, difference, color, expected, square, color_square = pooled.split_with_sizes([1, 3, 3, 3, 1, 1], dim=1)
    share = 1.0 / count.clamp(min=1e-6)
    residual = (difference * share).square().sum(dim=1, keepdim=True)
    mean_square = (color * share).square().sum(dim=1, keepdim=True)
    return Windows(
        (expected * share).amax(dim=1, keepdim=True),
        residual,
        (square * share - residual).clamp(min=0.0),
        (color_square * share - mean_square).clamp(min=0.0),
    )


def excess(square: Tensor, variance: Tensor, ratio: float, window: Windows, exposure: Tensor) -> Tensor:
    """How far a square is over `ratio` times a variance and FLICKER, as a part of the light squared."""
    level = window.level + DARK / exposure
    return ((square - ratio * variance) / (level * level) - FLICKER * FLICKER).clamp(-OLDEST, OLDEST)


def at_samples(image: Tensor, render: Size, jitter: Tensor) -> Tensor:
    """Read an image of the display bilinearly where the samples are: (1, c, H, W) -> (1, c, h, w)."""
    display = render_size_of(image)
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
    """(render,) positions of the samples of one axis in display pixels, 0 is a pixel's centre."""
    sample = torch.arange(render, dtype=torch.float32, device=jitter.device)
    return (sample + 0.5 + jitter) * display / render - 0.5


def whole_tiles(stays: Tensor) -> Tensor:
    """(1, 1, H, W) 1 in the tiles of TILE pixels in which all pixels stay frozen, else 0."""
    width, height = render_size_of(stays)
    tiles = -F.max_pool2d(F.pad(-stays, (0, TILE - 1, 0, TILE - 1), value=-1.0), TILE)
    for axis, extent in ((3, width), (2, height)):
        tiles = tiles.index_select(axis, torch.arange(extent, device=stays.device) // TILE)
    return tiles
