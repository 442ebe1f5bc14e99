"""Convergence of what stands still: the running mean of its samples, faded in beside a method's own image.

A method keeps its own history and image. Where a display pixel stands still, `settle` adds the samples near
it to a mean in linear RGB without exposure, with weights W of a Gaussian within a tent of one pixel:

    N' = N + W,  c' = c + W / (N' + E) (u - c),  E = clamp(N' - PERIOD, 0, PERIOD)

u is the weighted mean of this frame's samples. With E, samples of later periods change the mean less, and so
do parts of a period. The image fades from the method's to the mean as N' grows from READY to PERIOD.
Exposed samples are limited to white plus BRIGHTENING times the mean, and the mean of few samples to
white plus BRIGHTENING times those of the frame.
A frame with the jitter of the previous one adds nothing: without jitter the method's image is the better one.
A jitter of few phases is averaged as it is: at ratio 1 that is nearer to the truth, at others about as near.

A pixel opens where samples differ from the mean in another way than before. The residual of a sample is its
shown luma less that of the mean there, averaged over 5x5 samples. Its range over the learning time is kept;
then a residual out of that range by more than MARGIN opens the 5x5 samples. While the range is learned, the
distance is larger: where patterns are finer than a sample, residuals differ much from phase to phase. In a
frame that opens a pixel, the image is the method's and no sample is added there. If the next frame confirms
it on the same side, the mean restarts. Otherwise it was a firefly: the colour is kept with at most the weight
of one period, and the range is learned again.

A fine pattern that takes the place of another of the same brightness hardly changes the averages. So a pixel
is also doubted where the samples follow another pattern than the mean: where the mean has contrast in the
5x5 samples, and the slope of the samples on it is below FOLLOWS. In one frame that may be chance, if patterns
are finer than a sample: the image still shows the mean, and only its weight is limited. A second frame
restarts the mean.

A frame that adds nothing compares no pattern, leaves doubts to the next frame, and is no part of the learning
time, which must be more than a period of the jitter. Nor does a frame whose `adds_samples` is 0, as an
extrapolated one. Where a frame is reactive, the image shows that much less of the mean.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.convergence import (
    BRIGHTENING,
    DOUBTED,
    FIREFLY,
    FOLLOWS,
    FOLLOWS_DOUBTED,
    LEARNED,
    LEAST_CONTRAST,
    LEAST_RELATIVE_CONTRAST,
    MARGIN,
    MARGIN_LEARNING,
    MAX_STATIC_MOTION,
    MOST_LEARNING,
    PATTERN_READY,
    PERIOD,
    READY,
    SIGMA,
    SPREADS,
    UNBOUNDED,
)
from supersampler_model.ops.color import bounded, glaring, largest, luminance, sanitize, valid
from supersampler_model.ops.motion import squared_length, usable_motion
from supersampler_model.ops.sampling import (
    Grid,
    gaussian,
    grid_bands,
    linear,
    nearest,
    normalised,
    pick,
    pick_first,
    resample,
)
from supersampler_model.ops.size import Size, render_size_of
from supersampler_model.ops.windows import channels_of, padded_3x3, shifted, window_sum

DARK = 0.002  # luma below which `shown_luma` is less steep: a screen is, too
COVERED = 0.999  # of four bilinear weights


class FrameSamples(NamedTuple):
    """This frame, at render size."""

    color: Tensor  # (1, 3, h, w) linear RGB as given: any value
    motion: Tensor  # (1, 2, h, w) render pixels
    jitter: Tensor  # (1, 2) render pixels
    previous_jitter: Tensor  # (1, 2) of the previous frame
    exposure: Tensor  # (1,) > 0
    reactive: Tensor  # (1, 1, H, W) of `reactive_at`
    adds_samples: Tensor  # (1,) 0: the frame adds none, as extrapolated ones


class Settled(NamedTuple):
    """The image and the next history."""

    image: Tensor  # (1, 3, H, W) linear RGB
    still: Tensor  # (1, 4, H, W) mean, and the sum of its weights: negative once opened or doubted
    opening: Tensor  # (1, 3, h, w) least and largest residual, and the number of samples they were learned of
    converged: Tensor  # (1, 1, H, W) fraction of the mean in the image


def settle(
    image: Tensor, frame: FrameSamples, history_still: Tensor, history_opening: Tensor, grid: Grid
) -> Settled:
    """Add this frame's samples to the mean where pixels stand still, and fade the image to it.

    Args:
        image: (1, 3, H, W) the method's, linear RGB.
        frame: this frame.
        history_still: (1, 4, H, W) `Settled.still` of the previous frame; zeros without one.
        history_opening: (1, 3, h', w') `Settled.opening` of the previous frame.
        grid: of the frame; it may extend beyond the image.
    """
    display, render = render_size_of(image), render_size_of(frame.color)
    ratio = display.width / render.width, display.height / render.height
    across, down = (
        axis._replace(outputs=extent)
        for axis, extent in zip(
            grid_bands(grid, render, tent_gaussian, reach=1, scale=ratio), display, strict=True
        )
    )
    grid = grid.cut_to(display)
    color, usable = sanitize(frame.color, 0.0), valid(frame.color)
    usable = usable * (1.0 - glaring(color * frame.exposure, usable))
    color = without_fireflies(color * usable, frame.exposure)
    moving = (squared_length(usable_motion(frame.motion)) > MAX_STATIC_MOTION * MAX_STATIC_MOTION).float()
    jitters = (frame.jitter - frame.previous_jitter).abs().sum() > 0.0
    adds = (jitters & (frame.adds_samples > 0.0)).float()
    opening, opens = measure_residuals(frame, color, usable, moving, adds, history_still, history_opening)

    moves = torch.maximum(moving, shifted(moving, 1, 0))
    stands = 1.0 - pick_first(torch.maximum(moves, shifted(moves, 0, 1)), grid)
    opened = pick(F.max_pool2d(opens, 5, 1, 2), grid)

    mean, weight = history_still.split_with_sizes([3, 1], dim=1)
    shows_own = (opened > DOUBTED).float()
    confirmed = (opened > 0.0) & (weight < 0.0)
    stays = (weight < 0.0) & (adds <= 0.0)
    weight = weight.abs() * stands * (1.0 - confirmed.float())
    rejected = (opened > 0.0) & (weight > 0.0)
    near = resample(torch.cat([color, usable], dim=1), across, down)
    near, near_weight = near.split_with_sizes([3, 1], dim=1)
    added = near_weight * stands * (1.0 - rejected * shows_own) * adds
    total = weight + added
    share = added / (total + (total - PERIOD).clamp(0.0, PERIOD)).clamp(min=1e-6)
    samples = near / near_weight.clamp(min=1e-6)
    sample_peak, mean_peak = largest(samples) * frame.exposure, largest(mean) * frame.exposure
    early = (weight < READY) & (added > 0.0)
    mean = mean * darkening(mean_peak, torch.where(early, sample_peak, mean_peak))
    samples = samples * darkening(sample_peak, torch.where(weight > 0.0, mean_peak, sample_peak))
    mean = mean + share * (samples - mean)
    converged = ((total - READY) / (PERIOD - READY)).clamp(0.0, 1.0) * (1.0 - shows_own)
    converged = converged * (1.0 - frame.reactive)
    next_weight = torch.where(rejected | stays, -total.clamp(max=PERIOD), total)
    return Settled(
        bounded(image + converged * (mean - image)),
        torch.cat([mean, next_weight], dim=1),
        opening,
        converged,
    )


def without_fireflies(color: Tensor, exposure: Tensor) -> Tensor:
    """Darken samples that are alone far brighter than white and their neighbours.

    In a linear mean of few samples one of them would stay visible for many periods.
    """
    peak = largest(color) * exposure
    padded = padded_3x3(peak)
    sides = F.max_pool2d(padded, (3, 2), 1, dilation=(1, 2))  # the columns left and right of each pixel
    ends = F.max_pool2d(padded[..., 1:-1], (2, 1), 1, dilation=(2, 1))
    most = FIREFLY * (1.0 + torch.maximum(sides, ends))
    return color * (most / torch.maximum(peak, most))


def darkening(peak: Tensor, other: Tensor) -> Tensor:
    """Factor that limits an exposed peak to white plus BRIGHTENING times another.

    In a linear mean the light of one frame would stay visible for many periods.
    """
    most = 1.0 + BRIGHTENING * other
    return most / torch.maximum(peak, most)


def measure_residuals(
    frame: FrameSamples,
    color: Tensor,
    usable: Tensor,
    moving: Tensor,
    adds: Tensor,
    history_still: Tensor,
    history_opening: Tensor,
) -> tuple[Tensor, Tensor]:
    """Compare the samples with the mean.

    Args:
        frame: this frame.
        color: (1, 3, h, w) linear RGB, 0 where a sample does not count.
        usable: (1, 1, h, w) 1 where it counts.
        moving: (1, 1, h, w) 1 where a sample moves.
        adds: () 1 if the frame adds samples, else 0.
        history_still: see `settle`.
        history_opening: see `settle`.

    Returns:
        The next `Settled.opening`, and (1, 1, h, w) what opens: 1, or DOUBTED where only the pattern differs.
    """
    render, display = render_size_of(usable), render_size_of(history_still)
    weight = history_still[:, 3:4]
    ready, doubted = (weight.abs() > READY).float(), (weight < 0.0).float()
    young = (weight.abs() < PATTERN_READY).float()
    there = at_samples(torch.cat([history_still[:, :3], ready, young, doubted], dim=1), render, frame.jitter)
    mean, ready, young, doubted = there.split_with_sizes([3, 1, 1, 1], dim=1)
    known = (ready > COVERED) * (1.0 - moving)
    counted = known * usable
    expected = shown_luma(mean * frame.exposure)
    difference = (shown_luma(color * frame.exposure) - expected) * counted
    expected = expected * counted
    products = difference * difference, expected, expected * expected, difference * expected
    sums = window_sum(torch.cat([difference, *products, counted], dim=1), 5, padding=2)
    residual, square, level, level_square, product = channels_of(normalised(sums))
    variance = (square - residual * residual).clamp(min=0.0)
    spread, contrast = variance.sqrt(), level_square - level * level
    covariance = product - residual * level  # of differences and mean: the slope is 1 + covariance / contrast
    has_contrast = contrast > LEAST_RELATIVE_CONTRAST * variance + LEAST_CONTRAST * LEAST_CONTRAST
    least_slope = torch.where(doubted > 0.0, FOLLOWS_DOUBTED, FOLLOWS)
    other_pattern = (
        has_contrast & (young <= 0.0) & (adds > 0.0) & (contrast + covariance < contrast * least_slope)
    )

    previous = render_size_of(history_opening)
    before = of_size(history_opening, render)
    same = (one_like(frame.jitter, previous.width) == render.width) & (
        one_like(frame.jitter, previous.height) == render.height
    )
    before = before * same.float()
    low, high, learned = channels_of(before)
    learning = learned < LEARNED
    learning_margin = (MARGIN_LEARNING + SPREADS * spread).clamp(max=MOST_LEARNING)
    margin = torch.where(learning, learning_margin, MARGIN)
    below, above = residual < low - margin, residual > high + margin
    opens = known * torch.maximum(DOUBTED * other_pattern, (below | above).float())
    learns = learning & (opens <= 0.0)
    low = torch.where(learns, torch.minimum(low, residual), low)
    high = torch.where(learns, torch.maximum(high, residual), high)
    low, high = torch.where(above, -UNBOUNDED, low), torch.where(below, UNBOUNDED, high)
    new = one_like(frame.jitter, render.width * render.height) / (display.width * display.height)
    learned = (learned + learns * adds * new).clamp(max=LEARNED)
    keeps = known * (doubted * adds <= 0.0)
    return keeps * torch.cat([low, high, learned], dim=1), opens


def tent_gaussian(distance: Tensor) -> Tensor:
    """Weight of a sample in the mean, by its distance in display pixels along one axis."""
    return gaussian(SIGMA)(distance) * linear(distance)


def shown_luma(exposed: Tensor) -> Tensor:
    """(1, 1, h, w) luma nearly as a screen shows it, in [0, 1): 1 / 255 is a visible difference."""
    luma = luminance(exposed)
    return (luma / (1.0 + luma) + DARK).sqrt()


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


def of_size(image: Tensor, size: Size) -> Tensor:
    """Nearest resampling to a size: identity where it is the image's own."""
    own = render_size_of(image)
    x = torch.arange(size.width, device=image.device)
    y = torch.arange(size.height, device=image.device)
    columns = nearest((x + 0.5) * own.width / size.width - 0.5, own.width)
    return image.index_select(3, columns).index_select(
        2, nearest((y + 0.5) * own.height / size.height - 0.5, own.height)
    )


def one_like(tensor: Tensor, value: float) -> Tensor:
    """(1,) the value, which may be symbolic while a graph is exported."""
    return tensor.new_ones(1) * value
