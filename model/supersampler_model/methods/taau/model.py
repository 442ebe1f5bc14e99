"""`taau`: temporal upsampling without a network; the fallback, and the baseline of every network.

Each display pixel stores a colour, the number of accumulated samples, and the spread of those samples. A new
frame adds its samples near the pixel, weighted by distance. The number of samples of the history is reduced
where

* the pixel is disoccluded (foreground broader than two samples was closer in the previous frame),
* the lighting changed: the mean of a neighbourhood changed by more than jitter explains,
* light changes slowly while nothing moves, so that the history lags behind (`lag`),
* its colour lies outside a variance box of this frame's colours (Salvi 2016); it is then clipped to the box,
* motion resamples it: each resampling blurs, so more blur keeps fewer samples.

The box is widened by the spread of the pixel's own samples over time. Otherwise features thinner than the
sample distance vanish from the box in frames that miss them, and flicker: the weakness of variance clipping
that Salvi names. On smooth surfaces, whose shade differs from sample to sample, the box holds the plane
through the samples and the variance about it (`planes`), and a sample counts as no farther off than it is
from that plane, or from the mean around it: light that moves over them changes all samples alike. Otherwise
the history would lag in a wide box, and the samples of each frame would show as a grid.

Light ten stops over white (GLARING) that was not there before is shown, but accumulated only from its third
consecutive frame on. Until then the warped history is kept. A single bright frame, and an unshaded frame
extrapolated from it, therefore leave no trace. The same holds for less light, where it raises the contrast of
the whole frame (FLASH) and that around a pixel, but not the mean around it so far that light counts as
changed: there the history restarts.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.taau.spec import FLASH, FLASH_MEMORY, LEAST_FLASH, TAAU, TaauConfig
from supersampler_model.methods.base import Method
from supersampler_model.methods.taau.lag import samples_kept
from supersampler_model.methods.taau.planes import Moments, fit_of, plane_moments
from supersampler_model.ops.at_rest import RestFrame, RestHistory, compare, converge, kept, kept_frame
from supersampler_model.ops.color import (
    CONFIRMED,
    DARKNESS,
    GLARE,
    bounded,
    exposure_for,
    from_ycocg,
    glaring,
    inverse_tone,
    sanitize,
    tone,
    valid,
    without_glare,
    ycocg,
)
from supersampler_model.ops.compositing import reactive_at
from supersampler_model.ops.missing import filled
from supersampler_model.ops.motion import (
    Reprojection,
    dilate_motion_2x2,
    disocclusion,
    occluding_depth,
    read,
    read_cubic,
    reproject,
    to_display,
    usable_depth,
    usable_motion,
)
from supersampler_model.ops.rectification import Box, clip_to_center, overshoot
from supersampler_model.ops.sampling import (
    MIN_WEIGHT,
    Grid,
    View,
    catmull_rom,
    gaussian,
    grid_of,
    normalised,
    pick,
    pick_first,
    pick_first_vector,
    upsample,
)
from supersampler_model.ops.size import Size, display_size_of, render_size_of
from supersampler_model.ops.windows import blurred, channels_of, maximum_3x3

MIN_CHANGE = 0.004  # of toned luma: one step of an 8-bit image
MIN_SAMPLES = 1e-3  # with fewer samples the history is not used
MIN_BOX_WEIGHT = 0.5  # of the samples in the window of the box, a fraction


class CurrentFrame(NamedTuple):
    """This frame at display size; colours are toned YCoCg."""

    frame: Tensor  # (1, 3, H, W) smooth upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) sum of their Gaussian weights, [0, 1]
    moments: Moments  # of the samples around each pixel
    fit: Tensor  # (1, 1, H, W) whether 3x3 samples are on a plane, [0, 1]
    shade: Tensor  # (1, 2, H, W) mean and deviation of luma over 3x3 samples
    glare: Tensor  # (1, 1, H, W) 1 where one of those samples is over GLARING


class WarpedHistory(NamedTuple):
    """The warped history at display size."""

    light: Tensor  # (1, 3, H, W) linear RGB
    color: Tensor  # (1, 3, H, W) the same, toned YCoCg
    samples: Tensor  # (1, 1, H, W) number of accumulated samples, 0 without history
    power: Tensor  # (1, 1, H, W) mean square of sample - history, toned luma, as `Taau.finish` limits it
    shade: Tensor  # (1, 2, H, W) as in CurrentFrame
    glare: Tensor  # (1, 1, H, W) consecutive frames with light over GLARING nearby, up to CONFIRMED
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
    kept: Tensor  # (1, 1, H, W) number in the history there
    unconfirmed: Tensor  # (1, 1, H, W) whether this frame adds no sample


class Step(NamedTuple):
    """The image, the next history and the weight of the history."""

    image: Tensor
    history_color: Tensor
    history_samples: Tensor
    history_surface: Tensor
    history_jitter: Tensor
    history_exposure: Tensor
    history_light: Tensor
    history_static_mean: Tensor
    history_static_blocks: Tensor
    history_signatures: Tensor
    history_phases: Tensor
    weight: Tensor
    converged: Tensor


class Taau(Method):
    """Temporal upsampling of accumulated samples."""

    spec: ClassVar = TAAU
    config: TaauConfig

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
    ) -> Step:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the weight of the history."""
        display, render = display_size_of(display_size), render_size_of(color)
        history_color, samples_before, surface_before, jitter_before, *others = history
        exposed_before, light, *rest = others
        grid = grid_of(display, render, jitter)
        given_color, usable, color = color, valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, exposed_before)
        exposure = followed.abs()
        exposed = filled(color, usable, exposure) * exposure
        toned, glare = ycocg(tone(exposed)), glaring(exposed, usable)
        depth, motion = usable_depth(depth), usable_motion(motion)
        surface = torch.cat([occluding_depth(depth, motion), shade_of(toned[:, :1] * usable, usable)], dim=1)

        current = self.gather_current(toned, usable, glare, surface, grid, display, render)
        closest, dilated = dilate_motion_2x2(depth, motion)
        closest = pick_first(closest, grid)
        reprojection = reproject(pick_first_vector(to_display(dilated, display, render), grid), display, grid)
        exposure_before = exposed_before.abs()
        change = exposure / torch.where(exposure_before > 0.0, exposure_before, exposure)
        before = self.gather_surface(surface_before, jitter_before, reprojection, closest, display, change)
        warped = self.gather_history(history_color, samples_before, reprojection, before, exposure)
        next_light = light_after(light_of(surface[:, 1:3]), light, change)
        frame = RestFrame(given_color, motion, jitter, exposure, reactive, adds_samples)
        still = compare(frame, RestHistory(*rest), render_size_of(surface_before), display)
        kept_samples = samples_kept(exposed, usable, history_color * exposure, still, self.config)
        samples = torch.minimum(warped.samples, still.at_pixels.pick(kept_samples))
        warped = warped._replace(samples=samples)
        blend = self.network(current, warped, next_light[:, 3:4])
        reactive = reactive_at(reactive, usable, grid)
        image, samples = self.finish(current, warped, blend, exposure, reactive)
        next_color = torch.where(blend.unconfirmed, warped.light, image)
        weight = (1.0 - blend.weight) * (blend.samples > MIN_SAMPLES) * (1.0 - reactive)
        resting = still.resting(display)
        rested = converge(image, frame, still, grid)
        return Step(
            rested.image,
            kept(resting, history_color, next_color),
            kept(resting, samples_before, samples),
            kept_frame(still, surface_before, surface),
            kept_frame(still, jitter_before, jitter),
            kept_frame(still, exposed_before, followed),
            kept_frame(still, light, next_light),
            *rested.history,
            weight,
            rested.frozen,
        )

    def gather_current(
        self,
        toned: Tensor,
        usable: Tensor,
        glare: Tensor,
        surface: Tensor,
        grid: Grid,
        display: Size,
        render: Size,
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame four ways, all separable.

        `toned`: (1, 3, h, w), filled where samples are missing; shown where no other is near.
        """
        ratio = display.width / render.width, display.height / render.height
        fill, toned = pick(toned, grid), toned * usable
        samples = torch.cat([toned, usable], dim=1)
        c = self.config
        smooth, found = upsample(samples, grid, gaussian(c.frame_sigma)).split_with_sizes([3, 1], dim=1)
        smooth = torch.where(found > MIN_WEIGHT, smooth / found.clamp(min=MIN_WEIGHT), fill)
        sharp, whole = upsample(samples, grid, catmull_rom).split_with_sizes([3, 1], dim=1)
        sharpness = c.frame_sharpness * (whole > 0.9)  # with missing samples the negative weights dominate
        near, weight = upsample(samples, grid, gaussian(c.sample_sigma), ratio).split_with_sizes(
            [3, 1], dim=1
        )
        fit = fit_of(toned[:, :1], usable, surface[:, 2:3])
        at_pixel = pick(torch.cat([surface[:, 1:3], fit, maximum_3x3(glare)], dim=1), grid)
        shade, fit, glare = at_pixel.split_with_sizes([2, 1, 1], dim=1)
        return CurrentFrame(
            frame=smooth + sharpness * (sharp / whole.clamp(min=1e-6) - smooth),
            sample=near / weight.clamp(min=1e-6),
            confidence=weight.clamp(max=1.0),
            moments=plane_moments(toned, usable, fit, grid, c.moment_sigma, MIN_BOX_WEIGHT),
            fit=fit,
            shade=shade,
            glare=glare,
        )

    def gather_surface(
        self,
        history_surface: Tensor,
        history_jitter: Tensor,
        reprojection: Reprojection,
        depth: Tensor,
        display: Size,
        change: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Return the surface's previous visibility, (1, 1, H, W), and its shade at this exposure."""
        before = View(display, render_size_of(history_surface), history_jitter)
        position = before.to_render(reprojection.position)
        c = self.config
        occluded = disocclusion(depth, history_surface[:, :1], position, c.depth_margin, c.depth_ramp)
        same = reprojection.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0)

        mean, deviation = channels_of(read(history_surface[:, 1:3], position))
        dim = 1.0 + (change - 1.0) * mean  # c / (1 + c) at another exposure, and its slope
        return same, torch.cat([change * mean / dim, change * deviation / (dim * dim)], dim=1)

    def gather_history(
        self,
        history_color: Tensor,
        history_samples: Tensor,
        reprojection: Reprojection,
        surface: tuple[Tensor, Tensor],
        exposure: Tensor,
    ) -> WarpedHistory:
        """Warp the history."""
        position = reprojection.position
        light = sanitize(read_cubic(history_color, position, self.config.history_sharpness), 0.0)
        samples, power = channels_of(read(history_samples, position))
        power, glare = without_glare(power)
        return WarpedHistory(
            light=light,
            color=ycocg(tone(light * exposure)),
            samples=samples,
            power=power,
            shade=surface[1],
            glare=glare,
            surface=surface[0],
            speed=reprojection.speed(),
            blur=reprojection.blur(),
        )

    def network(self, current: CurrentFrame, warped: WarpedHistory, flash: Tensor) -> Blend:
        """Compute the blend parameters by rules, in place of a network; `flash`: last of `light_after`."""
        c = self.config
        unchanged = 1.0 - self.change_of_light(current.shade, warped.shade)
        unknown = (warped.glare > 0.0) & (
            warped.glare < CONFIRMED
        )  # its shade includes light that was not accumulated
        unchanged = torch.where(unknown, 1.0, unchanged)
        spread = warped.power.sqrt() * unchanged
        gamma = c.gamma_still + (c.gamma_moving - c.gamma_still) * (warped.speed / c.gamma_speed).clamp(
            max=1.0
        )
        center, variance = current.moments
        box = Box(center, gamma * variance.sqrt() + c.gamma_time * spread)

        inside = 1.0 - (c.forget * (overshoot(warped.color, box) - 1.0)).clamp(0.0, 1.0)
        limit = c.samples / (1.0 + c.blur_cost * warped.blur + c.speed_cost * warped.speed)
        holds = warped.surface * unchanged
        samples = torch.minimum(warped.samples * holds * inside, limit)
        weight = current.confidence / (samples + current.confidence).clamp(min=1e-6)
        glares = (current.glare > 0.0) & (warped.glare < CONFIRMED - 1.0)
        trusted = torch.where(glares, warped.surface, holds)
        kept = torch.minimum(warped.samples * trusted, limit)
        now, before = current.shade[:, 1:2], warped.shade[:, 1:2]
        flashes = (flash > 1.0) | ((flash > 0.0) & exceeds(now * now, before * before))
        unconfirmed = (glares | flashes) & (kept > MIN_SAMPLES)
        return Blend(clip_to_center(warped.color, box), weight, samples, holds, trusted, kept, unconfirmed)

    def change_of_light(self, now: Tensor, before: Tensor) -> Tensor:
        """(1, 1, H, W) 1 where the mean luma of a neighbourhood changed by more than jitter explains."""
        c = self.config
        moved = (now[:, :1] - before[:, :1]).abs()
        jitter = c.change_deviation * torch.maximum(now[:, 1:2], before[:, 1:2])
        noise = jitter + c.change_relative * torch.maximum(now[:, :1], before[:, :1]) + MIN_CHANGE
        return ((moved / noise - 1.0) / c.change_ramp).clamp(0.0, 1.0)

    def finish(
        self,
        current: CurrentFrame,
        warped: WarpedHistory,
        blend: Blend,
        exposure: Tensor,
        reactive: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Blend, or use this frame alone with few samples; return linear RGB and the next samples.

        `reactive`, (1, 1, H, W), is how much of the image is this frame alone whatever the samples.
        """
        settled = (blend.samples / self.config.settled).clamp(max=1.0)
        sample = current.frame + settled * (current.sample - current.frame)
        color = blend.history + blend.weight * (sample - blend.history)
        color = torch.where(blend.samples > MIN_SAMPLES, color, current.frame)
        color = color + reactive * (current.frame - color)
        samples = blend.samples * (1.0 - reactive)
        image = bounded(inverse_tone(from_ycocg(color).clamp(min=0.0)) / exposure)

        reach = warped.power.sqrt() + self.config.spread_step
        luma = current.sample[:, :1]
        contrast = (luma - current.shade[:, :1]).abs()
        about_plane = (luma - current.moments.center[:, :1]).abs().minimum(contrast)
        contrast = contrast + current.fit * (about_plane - contrast)
        error = (luma - warped.color[:, :1]).abs().minimum(reach).minimum(contrast)
        counted = samples.clamp(max=self.config.spread_samples) + current.confidence
        rate = current.confidence / counted.clamp(min=1e-6)
        known = (blend.samples > MIN_SAMPLES).float() * blend.spreads
        power = known * (warped.power + rate * (error * error - warped.power) - DARKNESS).clamp(min=0.0)
        now = [samples + current.confidence, power + GLARE * CONFIRMED * current.glare]
        glare = (warped.glare + current.glare).clamp(max=CONFIRMED)
        before = [blend.kept, blend.trusted * warped.power + GLARE * glare]
        return image, torch.where(blend.unconfirmed, torch.cat(before, dim=1), torch.cat(now, dim=1))


def light_of(shade: Tensor) -> Tensor:
    """(1, 2) mean luma and mean square deviation over all samples of `shade_of`."""
    size = render_size_of(shade)
    planes = torch.cat([shade[:, :1], shade[:, 1:2] * shade[:, 1:2]], dim=1)
    return planes.sum(dim=(2, 3)) / (size.width * size.height)


def light_after(light: Tensor, before: Tensor, change: Tensor) -> Tensor:
    """(1, 4) `history.light` of the next frame: whether the light of this frame is unconfirmed.

    It is where the contrast of the previous frames does not explain that of this frame, and in one more such
    frame: an unshaded one may be extrapolated from it.

    Args:
        light: (1, 2) `light_of` this frame.
        before: (1, 4) `history.light`.
        change: (1,) ratio of the exposures.
    """
    dim = 1.0 + (change - 1.0) * before[:, :1]
    slope = change / (dim * dim)
    contrasts, flashes = slope * slope * before[:, 1:3], before[:, 3:4]
    last, older = contrasts[:, :1], contrasts[:, 1:2]
    known = torch.where(flashes > 0.0, older, torch.maximum(last, older))
    flash = (known > 0.0) & (flashes < 2.0) & exceeds(light[:, 1:2], known)
    return torch.cat([light, torch.maximum(last, FLASH_MEMORY * older), flash * (flashes + 1.0)], dim=1)


def exceeds(contrast: Tensor, before: Tensor) -> Tensor:
    """Whether a square deviation is more than that of previous frames explains."""
    return contrast > FLASH * before + LEAST_FLASH


def shade_of(luma: Tensor, usable: Tensor) -> Tensor:
    """(1, 2, h, w) mean and standard deviation of `luma` over the usable ones of 3x3 samples.

    Without usable samples the deviation is 1, so that no mean counts as changed.
    """
    sums = blurred(torch.cat([luma, luma * luma, usable], dim=1))
    known = (sums[:, 2:3] > MIN_WEIGHT).float()
    moments = normalised(sums)
    mean, square = moments[:, :1], moments[:, 1:2]
    deviation = (square - mean * mean).clamp(min=0.0).sqrt()
    return torch.cat([mean, deviation * known + (1.0 - known)], dim=1)
