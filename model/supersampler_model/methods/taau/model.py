"""`taau`: the strongest temporal upscaler without a network; the fallback, and the bar for every network.

Each display pixel keeps a colour, how many samples it is made of, and how far those samples spread. A new
frame adds its samples near that pixel, weighted by their distance. The past loses samples where

* depth says that it shows another surface (something broad was closer than what is there now),
* the light changed: the mean of a neighbourhood moved by more than jitter moves it,
* its colour lies outside a variance box of this frame's colours (Salvi 2016), which is then cut to the box,
* motion resamples it: each resampling blurs, so the more a frame blurs, the fewer samples are kept.

The box also reaches as far as the pixel's own samples have been spreading over time. Without that, whatever
is thinner than a sample's distance vanishes from the box in the frames that miss it and flickers, which Salvi
names as the weakness of variance clipping.

Light ten stops over white, where there was none near, is shown, but only accumulated from its third frame in
a row on: until then the history stays as it was there, warped. So what one frame alone has leaves no trace,
nor does what was drawn from that frame where the next one is not shaded.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.taau.spec import TAAU, TaauConfig
from supersampler_model.methods.base import (
    Method,
    Size,
    display_size_of,
    render_size_of,
)
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
from supersampler_model.ops.motion import (
    Past,
    covered,
    dilate_motion_2x2,
    morphological_opening,
    past_of,
    read,
    read_cubic,
    squared_length,
    usable_depth,
    usable_motion,
)
from supersampler_model.ops.rectification import clip_to_center, overshoot, variance_box
from supersampler_model.ops.sampling import (
    UNSEEN,
    Grid,
    View,
    blurred,
    catmull_rom,
    extreme,
    gaussian,
    grid_of,
    local_moments,
    normalised,
    pick,
    pick_first,
    upsample,
)

NOTICEABLE = 0.004  # of toned luma: changes below one step of an 8-bit picture are no changes
UNKNOWN = 1e-3  # with fewer samples than this the past is not looked at
SEEN = 0.5  # of the box's Gaussian, whose sum is 0.8 at least: with less than this, no sample near is usable


class Present(NamedTuple):
    """This frame at display size; colours are toned YCoCg."""

    frame: Tensor  # (1, 3, H, W) smooth upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) how near they are, [0, 1]; 0 where none is usable
    first: Tensor  # (1, 3, H, W) E[c]
    second: Tensor  # (1, 3, H, W) E[c^2]
    shade: Tensor  # (1, 2, H, W) mean and deviation of luma over 3x3 samples
    glare: Tensor  # (1, 1, H, W) 1 where one of them is over GLARING


class Remembered(NamedTuple):
    """The warped past at display size."""

    light: Tensor  # (1, 3, H, W) linear RGB
    color: Tensor  # (1, 3, H, W) the same, toned YCoCg
    samples: Tensor  # (1, 1, H, W) it is made of, 0 where there is no past
    power: Tensor  # (1, 1, H, W) mean square of sample - past, toned luma
    shade: Tensor  # (1, 2, H, W) as in Present
    glare: Tensor  # (1, 1, H, W) frames that have had light over GLARING near, up to CONFIRMED
    surface: Tensor  # (1, 1, H, W) 1 where it may show what is there now
    speed: Tensor  # (1, 1, H, W) display pixels
    blur: Tensor  # (1, 1, H, W) of this resampling, 0 on a pixel's centre, 1 on a corner of four


class Blend(NamedTuple):
    """What is decided per pixel."""

    past: Tensor  # (1, 3, H, W) rectified
    weight: Tensor  # (1, 1, H, W) of this frame's sample
    samples: Tensor  # (1, 1, H, W) of the past that count
    spreads: Tensor  # (1, 1, H, W) 1 where the past's spread still holds
    kept: Tensor  # (1, 1, H, W) samples of the past that stay where this frame adds none
    unconfirmed: Tensor  # (1, 1, H, W) whether this frame adds none


class Step(NamedTuple):
    """The image and what the next frame needs."""

    image: Tensor
    history_color: Tensor
    history_samples: Tensor
    history_surface: Tensor
    history_jitter: Tensor
    history_exposure: Tensor
    weight: Tensor


class Taau(Method):
    """Temporal upsampling of accumulated samples."""

    spec: ClassVar = TAAU

    def __init__(self, config: TaauConfig | None = None) -> None:
        super().__init__()
        self.config = config or TaauConfig()

    def forward(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        history_color: Tensor,  # (1, 3, H, W)
        history_samples: Tensor,  # (1, 2, H, W)
        history_surface: Tensor,  # (1, 3, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_exposure: Tensor,  # (1,)
    ) -> Step:
        """Return the image (1, 3, H, W), linear RGB >= 0, the history and the weight of the past."""
        display, render = display_size_of(display_size), render_size_of(color)
        grid = grid_of(display, render, jitter)
        usable, color = valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, history_exposure)
        exposure = followed.abs()
        exposed = color * exposure
        toned, glare = ycocg(tone(exposed)) * usable, glaring(exposed, usable)
        depth, motion = usable_depth(depth), usable_motion(motion)
        surface = torch.cat([morphological_opening(depth), shade_of(toned[:, :1], usable)], dim=1)

        present = self.gather_present(toned, usable, glare, surface, grid, display, render)
        closest = pick_first(torch.cat(dilate_motion_2x2(depth, motion), dim=1), grid)
        past = past_of(closest[:, 1:], display, render)
        exposure_before = history_exposure.abs()
        change = exposure / torch.where(exposure_before > 0.0, exposure_before, exposure)
        before = self.gather_surface(history_surface, history_jitter, past, closest[:, :1], display, change)
        remembered = self.gather_past(history_color, history_samples, past, before, exposure)
        blend = self.network(present, remembered)
        image, samples = self.finish(present, remembered, blend, exposure)
        left = torch.where(blend.unconfirmed, remembered.light, image)
        weight = (1.0 - blend.weight) * (blend.samples > UNKNOWN)
        return Step(image, left, samples, surface, jitter * 1.0, followed, weight)

    def gather_present(
        self,
        toned: Tensor,
        usable: Tensor,
        glare: Tensor,
        surface: Tensor,
        grid: Grid,
        display: Size,
        render: Size,
    ) -> Present:
        """Upsample the usable samples of this frame four ways, all separable."""
        ratio = display.width / render.width, display.height / render.height
        samples = torch.cat([toned, usable], dim=1)
        c = self.config
        smooth = normalised(upsample(samples, grid, gaussian(c.frame_sigma)))
        sharp = upsample(samples, grid, catmull_rom)  # some of its weights are negative: of no use alone
        sharpness = c.frame_sharpness * (sharp[:, 3:4] > 0.9)
        near = upsample(samples, grid, gaussian(c.sample_sigma), ratio)
        first, second = local_moments(toned, usable, grid, c.moment_sigma, SEEN)
        return Present(
            frame=smooth + sharpness * (normalised(sharp) - smooth),
            sample=normalised(near),
            confidence=near[:, 3:4].clamp(max=1.0),
            first=first,
            second=second,
            shade=pick(surface[:, 1:3], grid),
            glare=pick(extreme(glare, torch.maximum), grid),
        )

    def gather_surface(
        self,
        history_surface: Tensor,
        history_jitter: Tensor,
        past: Past,
        depth: Tensor,
        display: Size,
        change: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Read where the past may show what is there now (1, 1, H, W), and its shade at this exposure."""
        before = View(display, render_size_of(history_surface), history_jitter)
        x, y = before.to_render(past.x, past.y)
        c = self.config
        hidden = covered(depth, history_surface[:, :1], x, y, c.depth_margin, c.depth_ramp)
        same = past.on_screen * (1.0 - 2.0 * hidden).clamp(min=0.0)

        shade = read(history_surface[:, 1:3], x, y)
        mean, deviation = shade[:, :1], shade[:, 1:2]
        dim = 1.0 + (change - 1.0) * mean  # c / (1 + c) at another exposure, and its slope
        return same, torch.cat([change * mean / dim, change * deviation / (dim * dim)], dim=1)

    def gather_past(
        self,
        history_color: Tensor,
        history_samples: Tensor,
        past: Past,
        surface: tuple[Tensor, Tensor],
        exposure: Tensor,
    ) -> Remembered:
        """Warp the history."""
        light = sanitize(read_cubic(history_color, past.x, past.y, self.config.history_sharpness), 0.0)
        samples = read(history_samples, past.x, past.y)
        power, glare = without_glare(samples[:, 1:2])
        across, down = past.x - past.x.floor(), past.y - past.y.floor()
        return Remembered(
            light=light,
            color=ycocg(tone(light * exposure)),
            samples=samples[:, :1],
            power=power,
            shade=surface[1],
            glare=glare,
            surface=surface[0],
            speed=squared_length(past.motion).sqrt(),
            blur=2.0 * (across * (1.0 - across) + down * (1.0 - down)),
        )

    def network(self, present: Present, past: Remembered) -> Blend:
        """Decide by rules what a learned method decides by a network."""
        c = self.config
        unchanged = 1.0 - self.change_of_light(present.shade, past.shade)
        unknown = (past.glare > 0.0) & (past.glare < CONFIRMED)  # its shade is of light that it does not have
        unchanged = torch.where(unknown, torch.ones_like(unchanged), unchanged)
        spread = past.power.sqrt() * unchanged
        gamma = c.gamma_still + (c.gamma_moving - c.gamma_still) * (past.speed / c.gamma_speed).clamp(max=1.0)
        box = variance_box(present.first, present.second, gamma, floor=c.gamma_time * spread)

        inside = 1.0 - (c.forget * (overshoot(past.color, box) - 1.0)).clamp(0.0, 1.0)
        limit = c.samples / (1.0 + c.blur_cost * past.blur + c.speed_cost * past.speed)
        holds = past.surface * unchanged
        samples = torch.minimum(past.samples * holds * inside, limit)
        weight = present.confidence / (samples + present.confidence).clamp(min=1e-6)
        kept = torch.minimum(past.samples * past.surface, limit)
        unconfirmed = (present.glare > 0.0) & (past.glare < CONFIRMED - 1.0) & (kept > UNKNOWN)
        return Blend(clip_to_center(past.color, box), weight, samples, holds, kept, unconfirmed)

    def change_of_light(self, now: Tensor, before: Tensor) -> Tensor:
        """(1, 1, H, W) 1 where the mean luma of a neighbourhood moved by more than jitter explains."""
        c = self.config
        moved = (now[:, :1] - before[:, :1]).abs()
        jitter = c.change_deviation * torch.maximum(now[:, 1:2], before[:, 1:2])
        noise = jitter + c.change_relative * torch.maximum(now[:, :1], before[:, :1]) + NOTICEABLE
        return ((moved / noise - 1.0) / c.change_ramp).clamp(0.0, 1.0)

    def finish(
        self, present: Present, past: Remembered, blend: Blend, exposure: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Average, fall back on this frame where little is known, go back to linear RGB."""
        settled = (blend.samples / self.config.settled).clamp(max=1.0)
        sample = present.frame + settled * (present.sample - present.frame)
        color = blend.past + blend.weight * (sample - blend.past)
        color = torch.where(blend.samples > UNKNOWN, color, present.frame)
        image = bounded(inverse_tone(from_ycocg(color).clamp(min=0.0)) / exposure)

        reach = past.power.sqrt() + self.config.spread_step
        off = (present.sample[:, :1] - past.color[:, :1]).abs().minimum(reach)
        seen = blend.samples.clamp(max=self.config.spread_samples) + present.confidence
        rate = present.confidence / seen.clamp(min=1e-6)
        known = (blend.samples > UNKNOWN).float() * blend.spreads
        power = known * (past.power + rate * (off * off - past.power) - DARKNESS).clamp(min=0.0)
        now = [blend.samples + present.confidence, power + GLARE * CONFIRMED * present.glare]
        before = [blend.kept, past.surface * past.power + GLARE * (past.glare + 1.0)]
        return image, torch.where(blend.unconfirmed, torch.cat(before, dim=1), torch.cat(now, dim=1))


def shade_of(luma: Tensor, usable: Tensor) -> Tensor:
    """(1, 2, h, w) mean and standard deviation of `luma` over the usable ones of 3x3 samples.

    Without any, the deviation is 1: whatever the mean was or will be, it is no change.
    """
    sums = blurred(torch.cat([luma, luma * luma, usable], dim=1))
    seen = (sums[:, 2:3] > UNSEEN).float()
    moments = normalised(sums)
    mean, square = moments[:, :1], moments[:, 1:2]
    deviation = (square - mean * mean).clamp(min=0.0).sqrt()
    return torch.cat([mean, deviation * seen + (1.0 - seen)], dim=1)
