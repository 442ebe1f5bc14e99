"""`taau`: temporal upsampling without a network; the fallback, and the baseline of every network.

Each display pixel stores a colour, the number of accumulated samples, and the spread of those samples. A new
frame adds its samples near the pixel, weighted by distance. The sample count of the history is reduced where

* the pixel is disoccluded (foreground broader than two samples was closer in the previous frame),
* the light changed: the samples around differ from the history, in the mean, by more than aliasing explains,
* light changes slowly while nothing moves, so that the history lags behind (`samples_kept`),
* its colour lies outside a variance box of this frame's colours (Salvi 2016); it is then clipped to the box,
* motion resamples it: each resampling blurs, so more blur keeps fewer samples.

The spread of the pixel's own samples over time widens the box. Otherwise features thinner than the sample
distance would vanish from the box in frames that miss them, and flicker: the weakness of variance clipping
that Salvi names. On smooth surfaces, whose shade differs from sample to sample, the box is the plane through
the samples with the variance about it (`plane_moments`). The error of a sample there is at most its distance
from that plane, or from the mean around it, as moving light changes all samples alike. Otherwise the history
would lag in a wide box, and the samples of each frame would show as a grid.

New light ten stops over white (GLARE_EXPOSED) is shown, but accumulated only from its third consecutive frame
on. Until then the warped history is kept. A single bright frame, and an unshaded frame extrapolated from it,
therefore leave no trace. Darker light is treated in the same way where it raises the contrast of the whole
frame (FLASH). Where light counts as changed, the history restarts instead.
"""

from collections.abc import Sequence
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.at_rest import BLOCK, DARK, WINDOWS
from supersampler.methods.constants import CONFIRMED, DARKNESS, FULL_WEIGHT, GLARE, MIN_WEIGHT
from supersampler.methods.taau import spec as taau
from supersampler_model import ops
from supersampler_model.methods.base import Method
from supersampler_model.ops import at_rest


class Moments(NamedTuple):
    """Mean and variance of the samples in a window; luma is taken about its plane, as far as it fits."""

    center: Tensor  # (1, 3, H, W)
    variance: Tensor  # (1, 3, H, W) 1 where most samples of the window are not usable
    weight: Tensor  # (1, 1, H, W) fraction of the window that is usable, [0, 1]


class CurrentFrame(NamedTuple):
    """This frame at display size; colours are toned YCoCg."""

    frame: Tensor  # (1, 3, H, W) this frame alone: luma upsampled along edges, mean chroma
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) sum of their Gaussian weights, [0, 1]
    moments: Moments  # of the samples around each pixel
    fit: Tensor  # (1, 1, H, W) whether 3x3 samples are on a plane, [0, 1]
    shade: Tensor  # (1, 2, H, W) mean and deviation of luma over 3x3 samples
    glare: Tensor  # (1, 1, H, W) 1 where one of those samples is over GLARE_EXPOSED


class WarpedHistory(NamedTuple):
    """The warped history at display size."""

    light: Tensor  # (1, 3, H, W) linear RGB
    color: Tensor  # (1, 3, H, W) `light` in toned YCoCg
    samples: Tensor  # (1, 1, H, W) number of accumulated samples, 0 without history
    power: Tensor  # (1, 1, H, W) mean square of sample - history, toned luma, as `Taau.finish` limits it
    glare: Tensor  # (1, 1, H, W) consecutive frames with light over GLARE_EXPOSED nearby, up to CONFIRMED
    unchanged: Tensor  # (1, 1, H, W) 1 - `Taau.change_of_light`
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible
    speed: Tensor  # (1, 1, H, W) display pixels
    blur: Tensor  # (1, 1, H, W) of this resampling, 0 on a pixel's centre, 1 on a corner of four


class Blend(NamedTuple):
    """Blend parameters of each display pixel."""

    history: Tensor  # (1, 3, H, W) rectified
    weight: Tensor  # (1, 1, H, W) of this frame's sample
    samples: Tensor  # (1, 1, H, W) effective number in the history
    spreads: Tensor  # (1, 1, H, W) 1 where the spread of the history is still valid
    trusted: Tensor  # (1, 1, H, W) fraction of the history that is kept where this frame adds no sample
    kept: Tensor  # (1, 1, H, W) number of samples in the history there
    unconfirmed: Tensor  # (1, 1, H, W) whether this frame adds no sample


class Taau(Method):
    """Temporal upsampling of accumulated samples."""

    spec: ClassVar = taau.TAAU
    config: taau.TaauConfig

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        adds_samples: Tensor,  # (1,) 0: none
        *history: Tensor,  # as in `TAAU.history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the auxiliary outputs."""
        view = ops.View(ops.display_size_of(display_size), ops.size_of(color), jitter)
        display, render = view.display, ops.size_of(color)
        history_color, samples_before, surface_before, jitter_before, *others = history
        exposed_before, light, *rest = others
        grid = view.grid(render)
        given_color, usable, color = color, ops.valid(color), ops.sanitize(color, 0.0)
        followed = ops.exposure_for(color, usable, exposure, exposed_before)
        exposure = followed.abs()
        exposed = ops.filled(color, usable, exposure) * exposure
        toned, glare = ops.tone(exposed), ops.glaring(exposed, usable)
        peak, toned = ops.peak(toned), ops.ycocg(toned)
        depth, motion = ops.usable_depth(depth), ops.usable_motion(motion)
        surface, shade = ops.occluding_depth(depth, motion), shade_of(toned[:, :1] * usable, usable)

        current = self.gather_current(toned, usable, [glare, peak], shade, grid, view)
        closest, dilated = ops.dilate_motion_2x2(depth, motion)
        exposed_history = history_color * exposure
        power_before = samples_before[:, 1:]
        changed = self.change_of_light(toned[:, :1], usable, dilated, exposed_history, power_before, view)
        closest = grid.pick_first(closest)
        vectors = grid.pick_first_vectors(ops.to_display(dilated, display, render))
        reprojection = ops.reproject(vectors, display, grid)
        exposure_before = exposed_before.abs()
        change = exposure / torch.where(exposure_before > 0.0, exposure_before, exposure)
        before = ops.View(display, ops.size_of(surface_before), jitter_before)
        visible = self.gather_surface(surface_before, before, reprojection, closest)
        unchanged = 1.0 - at_pixels(changed, grid)
        warped = self.gather_history(
            history_color, samples_before, reprojection, visible, unchanged, exposure
        )
        next_light = light_after(light_of(shade), light, change)
        frame = at_rest.RestFrame(given_color, motion, jitter, exposure, reactive, adds_samples)
        blocks = at_rest.compare(frame, at_rest.RestHistory(*rest), ops.size_of(surface_before), display)
        limit = samples_kept(exposed, usable, exposed_history, blocks, self.config)
        samples = torch.minimum(warped.samples, blocks.at_pixels.pick(limit))
        warped = warped._replace(samples=samples)
        blend = self.network(current, warped, next_light[:, 3:4])
        reactive = ops.reactive_at(reactive, usable, grid)
        image, samples = self.finish(current, warped, blend, exposure, reactive)
        next_color = torch.where(blend.unconfirmed, warped.light, image)
        weight = (1.0 - blend.weight) * (blend.samples > taau.MIN_SAMPLES) * (1.0 - reactive)
        resting = blocks.resting(display)
        converged = at_rest.converge(image, frame, blocks, grid)
        return (
            converged.image,
            at_rest.kept(resting, history_color, next_color),
            at_rest.kept(resting, samples_before, samples),
            blocks.kept(surface_before, surface),
            blocks.kept(jitter_before, jitter),
            blocks.kept(exposed_before, followed),
            blocks.kept(light, next_light),
            *converged.history,
            weight,
            converged.frozen,
        )

    def gather_current(
        self,
        toned: Tensor,
        usable: Tensor,
        light: Sequence[Tensor],
        shade: Tensor,
        grid: ops.Grid,
        view: ops.View,
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame.

        `toned`, (1, 3, h, w), is filled where samples are missing; it is the result where no other is near.
        `light` is `ops.glaring` and `ops.peak` of the samples.
        """
        c = self.config
        luma = ops.upsample_along_edges(toned[:, :1], usable, grid)
        fill, toned = grid.pick(toned[:, 1:]), toned * usable
        samples = torch.cat([toned, usable], dim=1)
        near = grid.upsample(samples, ops.gaussian(c.sample_sigma), view.ratio)
        near, weight = near.split_with_sizes([3, 1], dim=1)
        fit = fit_of(toned[:, :1], usable, shade[:, 1:2])
        glare, peak = light
        at_pixel = grid.pick(torch.cat([shade, fit, ops.maximum_3x3(glare), peak], dim=1))
        shade, fit, glare, peak = at_pixel.split_with_sizes([2, 1, 1, 1], dim=1)
        moments = plane_moments(toned, usable, fit, grid, c.moment_sigma)
        chroma = torch.where(moments.weight > MIN_WEIGHT, moments.center[:, 1:], fill)
        frame = torch.cat([luma, chroma], dim=1)
        return CurrentFrame(
            frame=frame * ops.dimming(ops.from_ycocg(frame), peak),
            sample=near / weight.clamp(min=1e-6),
            confidence=weight.clamp(max=1.0),
            moments=moments,
            fit=fit,
            shade=shade,
            glare=glare,
        )

    def change_of_light(
        self,
        luma: Tensor,
        usable: Tensor,
        motion: Tensor,
        history: Tensor,
        power: Tensor,
        view: ops.View,
    ) -> Tensor:
        """Return whether light changed around each cell of 2x2 samples, [0, 1].

        Two samples of each cell, on its diagonal, are compared with the nearest pixels of the history where
        they were in the previous frame. Aliasing makes samples lighter or darker, light changes them alike:
        it changed where the mean difference over 3x3 cells is large for its deviation. In a regular pattern,
        such as a fence, all samples of one frame may miss the wires and differ alike. There, samples differed
        in earlier frames, too, so these differences count as deviation.

        Args:
            luma: (1, 1, h, w) toned, of the samples.
            usable: (1, 1, h, w) 1 where a sample counts, else 0.
            motion: (1, 2, h, w) render pixels, dilated.
            history: (1, 3, H, W) exposed colours of the previous frame.
            power: (1, 1, H, W) mean square of sample - history in earlier frames, plus GLARE.
            view: of this frame.

        Returns:
            (1, 1, h / 2, w / 2), sizes rounded up.
        """
        c = self.config
        size, display = ops.size_of(luma), view.display
        columns = at_rest.sample_positions(size.width, display.width, view.jitter[0, :1])
        rows = at_rest.sample_positions(size.height, display.height, view.jitter[0, 1:])
        across, down = ops.channels_of(motion)
        x, y = columns + across * view.ratio[0], rows[:, None] + down * view.ratio[1]
        on_screen = (x > -0.5) & (x < display.width - 0.5) & (y > -0.5) & (y < display.height - 0.5)
        samples = torch.cat([x, y, luma, usable * on_screen], dim=1)
        cells = ops.Size((size.width + 1) // 2, (size.height + 1) // 2)
        samples = ops.fit(samples, 2 * cells.width, 2 * cells.height)
        samples = torch.cat([samples[:, :, ::2, ::2], samples[:, :, 1::2, 1::2]], dim=2)
        x, y, luma, counts = ops.channels_of(samples)
        nearest = (ops.positions_of(x, y) + taau.ROUNDING).floor()
        before = ops.ycocg(ops.tone(ops.read(history, nearest, mode="nearest")))[:, :1]
        earlier, _ = ops.without_glare(ops.read(power, nearest, mode="nearest"))
        difference = (luma - before) * counts
        squares = difference * difference + c.change_spread * earlier * counts
        sums = torch.cat([difference, squares, counts], dim=1)
        upper, lower = sums.split_with_sizes([cells.height, cells.height], dim=2)
        difference, square, share = ops.channels_of(0.5 * ops.blurred(upper + lower))
        mean = difference / share.clamp(min=1e-6)
        variance = (square / share.clamp(min=1e-6) - mean * mean).clamp(min=0.0)
        noise = c.change_deviation * variance.sqrt() + c.least_change
        return (mean.abs() / noise - 1.0).clamp(0.0, 1.0) * (share > taau.MIN_WINDOW_WEIGHT)

    def gather_surface(
        self, history: Tensor, before: ops.View, reprojection: ops.Reprojection, depth: Tensor
    ) -> Tensor:
        """Return the previous visibility of the surface, (1, 1, H, W)."""
        position, c = before.to_render(reprojection.position), self.config
        occluded = ops.occlusion(depth, history, position, c.depth_margin, c.depth_ramp)
        return reprojection.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0)

    def gather_history(
        self,
        color: Tensor,
        samples: Tensor,
        reprojection: ops.Reprojection,
        visible: Tensor,
        unchanged: Tensor,
        exposure: Tensor,
    ) -> WarpedHistory:
        """Warp the history."""
        position = reprojection.position
        light = ops.sanitize(ops.read_cubic(color, position, self.config.history_sharpness), 0.0)
        samples, power = ops.channels_of(ops.read(samples, position))
        power, glare = ops.without_glare(power)
        return WarpedHistory(
            light=light,
            color=ops.ycocg(ops.tone(light * exposure)),
            samples=samples,
            power=power,
            glare=glare,
            unchanged=unchanged,
            surface=visible,
            speed=reprojection.speed(),
            blur=reprojection.blur(),
        )

    def network(self, current: CurrentFrame, warped: WarpedHistory, flash: Tensor) -> Blend:
        """Compute the blend parameters by rules, in place of a network; `flash`: last of `light_after`."""
        c = self.config
        spread = warped.power.sqrt() * warped.unchanged
        moving = (warped.speed / c.gamma_speed).clamp(max=1.0)
        gamma = c.gamma_still + (c.gamma_moving - c.gamma_still) * moving
        center, variance = current.moments[:2]
        box = ops.Box(center, gamma * variance.sqrt() + c.gamma_time * spread)

        inside = 1.0 - (c.forget * (ops.overshoot(warped.color, box) - 1.0)).clamp(0.0, 1.0)
        limit = c.samples / (1.0 + c.blur_cost * warped.blur * warped.blur + c.speed_cost * warped.speed)
        holds = warped.surface * warped.unchanged
        samples = torch.minimum(warped.samples * holds * inside, limit)
        weight = current.confidence / (samples + current.confidence).clamp(min=1e-6)
        glares = (current.glare > 0.0) & (warped.glare < CONFIRMED - 1.0)
        trusted = torch.where(glares, warped.surface, holds)
        kept = torch.minimum(warped.samples * trusted, limit)
        unconfirmed = (glares | (flash > 0.0)) & (kept > taau.MIN_SAMPLES)
        return Blend(
            ops.clip_to_center(warped.color, box), weight, samples, holds, trusted, kept, unconfirmed
        )

    def finish(
        self, current: CurrentFrame, warped: WarpedHistory, blend: Blend, exposure: Tensor, reactive: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Blend, or show this frame alone where samples are few; return linear RGB and the next samples.

        `reactive`, (1, 1, H, W), is the fraction of this frame alone in the image.
        """
        settled = (blend.samples / self.config.settled).clamp(max=1.0)
        sample = current.sample + (1.0 - settled) * (current.frame - current.sample)
        color = blend.history + blend.weight * (sample - blend.history)
        color = torch.where(blend.samples > taau.MIN_SAMPLES, color, current.frame)
        color = color + reactive * (current.frame - color)
        samples = blend.samples * (1.0 - reactive)
        image = ops.bounded(ops.inverse_tone(ops.from_ycocg(color).clamp(min=0.0)) / exposure)

        reach = warped.power.sqrt() + self.config.spread_step
        luma = current.sample[:, :1]
        contrast = (luma - current.shade[:, :1]).abs()
        about_plane = (luma - current.moments.center[:, :1]).abs().minimum(contrast)
        contrast = contrast + current.fit * (about_plane - contrast)
        error = (luma - warped.color[:, :1]).abs().minimum(reach).minimum(contrast)
        counted = samples.clamp(max=self.config.spread_samples) + current.confidence
        rate = current.confidence / counted.clamp(min=1e-6)
        known = (blend.samples > taau.MIN_SAMPLES).float() * blend.spreads
        power = known * (warped.power + rate * (error * error - warped.power) - DARKNESS).clamp(min=0.0)
        now = [samples + current.confidence, power + GLARE * CONFIRMED * current.glare]
        glare = (warped.glare + current.glare).clamp(max=CONFIRMED)
        before = [blend.kept, blend.trusted * warped.power + GLARE * glare]
        return image, torch.where(blend.unconfirmed, torch.cat(before, dim=1), torch.cat(now, dim=1))


def at_pixels(cells: Tensor, grid: ops.Grid) -> Tensor:
    """Interpolate values of cells of 2x2 samples at the display pixels."""
    x, y = (axis._replace(position=0.5 * axis.position - 0.25) for axis in (grid.x, grid.y))
    return grid._replace(x=x, y=y).upsample(cells, ops.linear)


def light_of(shade: Tensor) -> Tensor:
    """Return mean luma and mean square deviation over all samples of `shade_of`, (1, 2)."""
    size = ops.size_of(shade)
    planes = torch.cat([shade[:, :1], shade[:, 1:2] * shade[:, 1:2]], dim=1)
    return planes.sum(dim=(2, 3)) / (size.width * size.height)


def light_after(light: Tensor, before: Tensor, change: Tensor) -> Tensor:
    """Return `history.light` of the next frame, (1, 4), with a flag: the light of this frame is unconfirmed.

    It is unconfirmed if the contrast of the previous frames does not explain that of this frame. One more
    such frame is unconfirmed, too, as it may be extrapolated from the first one. `light`, (1, 2), is
    `light_of` this frame, `before`, (1, 4), the history, and `change`, (1,), the ratio of the exposures.
    """
    dim = 1.0 + (change - 1.0) * before[:, :1]
    slope = change / (dim * dim)
    contrasts, flashes = slope * slope * before[:, 1:3], before[:, 3:4]
    last, older = contrasts[:, :1], contrasts[:, 1:2]
    known = torch.where(flashes > 0.0, older, torch.maximum(last, older))
    exceeds = light[:, 1:2] > taau.FLASH * known + taau.LEAST_FLASH
    flash = (known > taau.NO_CONTRAST) & (flashes < 2.0) & exceeds
    return torch.cat([light, torch.maximum(last, taau.FLASH_MEMORY * older), flash * (flashes + 1.0)], dim=1)


def shade_of(luma: Tensor, usable: Tensor) -> Tensor:
    """Return mean and standard deviation of `luma`, (1, 2, h, w), over the usable ones of 3x3 samples.

    Without usable samples the deviation is 1, so that no mean counts as changed.
    """
    sums = ops.blurred(torch.cat([luma, luma * luma, usable], dim=1))
    known = (sums[:, 2:3] > MIN_WEIGHT).float()
    moments = ops.normalised(sums)
    mean, square = moments[:, :1], moments[:, 1:2]
    deviation = (square - mean * mean).clamp(min=0.0).sqrt()
    return torch.cat([mean, deviation * known + (1.0 - known)], dim=1)


def samples_kept(
    color: Tensor, usable: Tensor, history: Tensor, blocks: at_rest.StaticBlocks, config: taau.TaauConfig
) -> Tensor:
    """Return how many samples of the history are kept where light changes slowly, by block, (1, 1, hb, wb).

    On textured ground, the variance box does not detect such changes: previous colours are still in the box.
    But whatever the texture, the samples of a window have the same mean as the history there, if the light is
    constant. Some samples of each block that neither moves nor is frozen are compared with the nearest pixels
    of the history, toned. Few samples are kept where the mean difference of a window of such blocks exceeds
    its standard error.

    Args:
        color: (1, 3, h, w) this frame, exposed; finite.
        usable: (1, 1, h, w) 1 where a sample counts, else 0.
        history: (1, 3, H, W) colours of the history, exposed.
        blocks: static blocks of this frame.
        config: constants.
    """
    columns, rows = blocks.at_pixels.nearest(taau.LAG_STEP)
    before = ops.tone(history.index_select(3, columns).index_select(2, rows))
    now = ops.tone(color[:, :, :: taau.LAG_STEP, :: taau.LAG_STEP])
    free = (1.0 - blocks.moves) * (1.0 - blocks.stays)
    size, side = ops.size_of(free), WINDOWS[1]
    parts = torch.cat([now - before, before], dim=1) * usable[:, :, :: taau.LAG_STEP, :: taau.LAG_STEP]
    parts = ops.fit(parts, size.width * BLOCK // taau.LAG_STEP, size.height * BLOCK // taau.LAG_STEP)
    difference, level = ops.block_means(parts, BLOCK // taau.LAG_STEP).split_with_sizes([3, 3], dim=1)
    values = torch.cat([difference, difference * difference, level, torch.ones_like(free)], dim=1) * free
    sums = ops.spread(ops.block_means(extended(values, side - 1), side), side, size)
    difference, square, level, share = sums.split_with_sizes([3, 3, 3, 1], dim=1)
    difference, square, level = (part / share.clamp(min=1e-6) for part in (difference, square, level))
    variance = (square - difference * difference).clamp(min=0.0)
    error = (variance / (share * side * side - 1.0).clamp(min=1.0)).sqrt()
    lag = (difference.abs() - config.lag_deviations * error).amax(dim=1, keepdim=True)
    excess = lag / (level.amax(dim=1, keepdim=True) + DARK) - config.lag
    limit = config.lag_samples / excess.clamp(min=config.lag_samples / taau.MOST_SAMPLES)
    return torch.where(free * (share >= taau.LEAST_BLOCKS) > 0.0, limit, taau.MOST_SAMPLES)


def extended(blocks: Tensor, count: int) -> Tensor:
    """Append `count` rows and columns of zeros."""
    width, height = ops.size_of(blocks)
    down, across = (
        (torch.arange(extent + count, device=blocks.device) < extent).float() for extent in (height, width)
    )
    return ops.fit(blocks, width + count, height + count) * down[:, None] * across


class PlaneAxis(NamedTuple):
    """Filters of the samples along an axis, under a Gaussian window."""

    mean: ops.Bands  # weights that sum to 1
    slope: ops.Bands  # least-squares slope, per standard deviation of the positions in the window
    shift: Tensor  # (n,) mean position in the window less the pixel's, in these standard deviations

    @classmethod
    def of(cls, window: ops.Bands, first: ops.Bands, second: ops.Bands) -> "PlaneAxis":
        """Return the filters from the Gaussian, the Gaussian times distance, and times squared distance."""
        total = window.weights.sum(dim=2, keepdim=True)
        mean = first.weights.sum(dim=2, keepdim=True) / total
        variance = second.weights.sum(dim=2, keepdim=True) / total - mean * mean
        scale = 1.0 / variance.sqrt()
        slope = (first.weights - mean * window.weights) * scale / total
        shift = (mean * scale).reshape(-1)
        if window.outputs is not None:
            shift = shift.index_select(0, torch.arange(window.outputs, device=shift.device))
        return cls(window._replace(weights=window.weights / total), window._replace(weights=slope), shift)


def fit_of(luma: Tensor, usable: Tensor, deviation: Tensor) -> Tensor:
    """Return whether 3x3 samples are on a plane, (1, 1, h, w): 0 on detail and edges, 1 on smooth surfaces.

    On a smooth surface whose shade changes from sample to sample, variance clipping (Salvi 2016) finds as
    much contrast as on detail. Contrast about the plane of the samples is due to detail alone.

    Args:
        luma: (1, 1, h, w), 0 where not usable.
        usable: (1, 1, h, w) 1 or 0.
        deviation: (1, 1, h, w) standard deviation of these samples.
    """
    slope = luma.new_tensor([-1.0, 0.0, 1.0]).expand(3, 3) / 6.0
    slopes = F.conv2d(ops.padded_3x3(luma), torch.stack([slope, slope.T])[:, None])
    explained = (slopes * slopes).sum(dim=1, keepdim=True) * (6.0 / 9.0)
    fraction = explained / (deviation * deviation).clamp(min=1e-7)
    return ((fraction - taau.UNFIT) / (taau.FIT - taau.UNFIT)).clamp(0.0, 1.0) * (
        ops.blurred(usable) > FULL_WEIGHT
    )


def plane_moments(color: Tensor, usable: Tensor, fit: Tensor, grid: ops.Grid, sigma: float) -> Moments:
    """Return moments of the usable samples under a Gaussian at every display pixel.

    Args:
        color: (1, 3, h, w) YCoCg, 0 where not usable.
        usable: (1, 1, h, w) 1 or 0.
        fit: (1, 1, H, W) weight of the plane in the result.
        grid: grid of the display pixels.
        sigma: sigma of the Gaussian, render pixels.
    """
    window, render = ops.gaussian(sigma), ops.size_of(color)
    kernels = window, lambda d: d * window(d), lambda d: d * d * window(d)
    x, y = (PlaneAxis.of(*axis) for axis in zip(*(grid.bands(render, k) for k in kernels), strict=True))
    sums = ops.resample(torch.cat([color, color * color, usable], dim=1), x.mean, y.mean)
    first, second, weight = sums.split_with_sizes([3, 3, 1], dim=1)
    total = weight.clamp(min=1e-6)
    mean = first / total
    variance = (second / total - mean * mean).clamp(min=0.0)
    across, down = ops.resample(color[:, :1], x.slope, y.mean), ops.resample(color[:, :1], x.mean, y.slope)
    fit = fit * (weight > FULL_WEIGHT)  # the slopes are of whole windows
    luma = mean[:, :1] - fit * (across * x.shift + down * y.shift[:, None])
    luma_variance = (variance[:, :1] - fit * (across * across + down * down)).clamp(min=0.0)
    variance = torch.cat([luma_variance, variance[:, 1:]], dim=1)
    variance = torch.where(weight > taau.MIN_WINDOW_WEIGHT, variance, 1.0)
    return Moments(torch.cat([luma, mean[:, 1:]], dim=1), variance, weight)
