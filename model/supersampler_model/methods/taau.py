"""`taau`: the strongest temporal upscaler without a network; the fallback, and the bar for every network.

Each display pixel keeps a colour and how many samples it is made of. A new frame adds its samples near that
pixel, weighted by their distance. The past is dropped where depth says it shows another surface, and pulled
into a variance box, losing samples as it moves, where it shows another shade. Motion bounds the number of
samples kept, because each resampling of a moving history blurs it and each wrong one stays for as long.

Background: notes in docs/methods.md (TAAU, FSR2's confidence and depth tests, Salvi's variance clipping).
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler_model.color import (
    bounded,
    exposure_for,
    from_ycocg,
    inverse_tone,
    quarantine,
    tone,
    valid,
    ycocg,
)
from supersampler_model.method import DISPLAY, PREVIOUS, Method, Size, display_size_of, render_size_of
from supersampler_model.motion import (
    Past,
    closest,
    past_of,
    read,
    read_catmull_rom,
    squared_length,
    usable_depth,
    usable_motion,
)
from supersampler_model.rectification import clip_to_center, overshoot, variance_box
from supersampler_model.sampling import Grid, gaussian, grid_of, pick, resample, taps


@dataclass(frozen=True)
class TaauConfig:
    """Constants, found by `supersampler bench tune` on moving and still scenes (docs/methods.md).

    Attributes:
        frame_sigma: Gaussian that upsamples this frame alone, render pixels.
        sample_sigma: Gaussian of a sample's influence on the accumulated colour, display pixels.
        moment_sigma: Gaussian window of the moments of the variance box, render pixels.
        gamma_still, gamma_moving: half size of the box in standard deviations, at rest and from `gamma_speed`
            display pixels a frame on.
        kept_outside: share of its way into the box that a colour outside is spared.
        count_still, count_moving: samples kept at rest and from `count_speed` display pixels a frame on.
        forget: share of the samples dropped per half box extent of overshoot.
        depth_margin, depth_ramp: relative depth by which all of the past must be closer before it counts as
            another surface, and over which that becomes certain.
    """

    frame_sigma: float = 0.4
    sample_sigma: float = 0.5
    moment_sigma: float = 0.47
    gamma_still: float = 3.2
    gamma_moving: float = 0.5
    gamma_speed: float = 8.0
    kept_outside: float = 0.45
    count_still: float = 18.0
    count_moving: float = 0.75
    count_speed: float = 0.14
    forget: float = 0.2
    depth_margin: float = 0.01
    depth_ramp: float = 0.2


class Present(NamedTuple):
    """This frame at display size; colours are toned YCoCg."""

    frame: Tensor  # (1, 3, H, W) smooth upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) how near they are, [0, 1]; 0 where none is usable
    first: Tensor  # (1, 3, H, W) E[c]
    second: Tensor  # (1, 3, H, W) E[c^2]


class Remembered(NamedTuple):
    """The warped past at display size."""

    color: Tensor  # (1, 3, H, W) toned YCoCg
    samples: Tensor  # (1, 1, H, W) samples that are still of this surface
    speed: Tensor  # (1, 1, H, W) display pixels a frame


class Blend(NamedTuple):
    """What is decided per pixel."""

    past: Tensor  # (1, 3, H, W) rectified
    weight: Tensor  # (1, 1, H, W) of this frame's sample
    samples: Tensor  # (1, 1, H, W) samples after this frame
    settled: Tensor  # (1, 1, H, W) 0 where only the smooth upsampling can be trusted


class Step(NamedTuple):
    """The image and what the next frame needs."""

    image: Tensor
    history_color: Tensor
    history_count: Tensor
    history_depth: Tensor
    history_jitter: Tensor
    history_exposure: Tensor


class Taau(Method):
    """Temporal upsampling with accumulated samples, depth disocclusion and variance clipping."""

    name, source = "taau", "temporal upsampling after Karis 2014, Salvi 2016 and FSR2 (docs/methods.md)"
    history: ClassVar = {
        "color": (1, 3, *DISPLAY),
        "count": (1, 1, *DISPLAY),
        "depth": (1, 1, *PREVIOUS),
        "jitter": (1, 2),
        "exposure": (1,),
    }

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
        history_color: Tensor,  # (1, 3, H, W) linear RGB
        history_count: Tensor,  # (1, 1, H, W) 0: no past
        history_depth: Tensor,  # (1, 1, h', w') reversed
        history_jitter: Tensor,  # (1, 2) of that depth
        history_exposure: Tensor,  # (1,)
    ) -> Step:
        """Return the image (1, 3, H, W), linear RGB >= 0, and the history."""
        display, render = display_size_of(display_size), render_size_of(color)
        grid = grid_of(display, render, jitter)
        exposure = exposure_for(quarantine(color, 0.0), exposure, history_exposure)
        depth, motion = usable_depth(depth), usable_motion(motion)

        present = self.gather_present(color, exposure, grid, display, render)
        past = past_of(pick(closest(depth, motion), grid), display, render)
        surface = self.same_surface(pick(depth, grid), past, history_depth, history_jitter, display)
        remembered = self.gather_past(history_color, history_count * 1.0, exposure, past, surface)
        blend = self.network(present, remembered)
        image = self.finish(present, blend, exposure)
        return Step(image, image, blend.samples, depth, jitter * 1.0, exposure)

    def gather_present(
        self, color: Tensor, exposure: Tensor, grid: Grid, display: Size, render: Size
    ) -> Present:
        """Upsample the usable samples of this frame three ways, all separable."""
        usable = valid(color)
        toned = ycocg(tone(quarantine(color, 0.0) * exposure)) * usable
        samples = torch.cat([toned, usable], dim=1)

        def under(image: Tensor, sigma: float, scale: tuple[float, float] = (1.0, 1.0)) -> Tensor:
            x = taps(grid.x, render.width, gaussian(sigma), scale=scale[0])
            y = taps(grid.y, render.height, gaussian(sigma), scale=scale[1])
            return resample(image, x, y)

        c = self.config
        frame = under(samples, c.frame_sigma)
        ratio = display.width / render.width, display.height / render.height
        near = under(samples, c.sample_sigma, ratio)
        window = under(torch.cat([samples, toned * toned], dim=1), c.moment_sigma)
        weight = window[:, 3:4].clamp(min=1e-6)
        return Present(
            frame=frame[:, :3] / frame[:, 3:4].clamp(min=1e-6),
            sample=near[:, :3] / near[:, 3:4].clamp(min=1e-6),
            confidence=near[:, 3:4].clamp(max=1.0),
            first=window[:, :3] / weight,
            second=window[:, 4:] / weight,
        )

    def same_surface(
        self, depth: Tensor, past: Past, history_depth: Tensor, history_jitter: Tensor, display: Size
    ) -> Tensor:
        """(1, 1, H, W) 1 where the past may show what is there now, 0 where all of it was closer."""
        before = render_size_of(history_depth)
        x = (past.x + 0.5) * before.width / display.width - 0.5 - history_jitter[0, 0]
        y = (past.y + 0.5) * before.height / display.height - 0.5 - history_jitter[0, 1]
        farthest = read(farthest_of_four(history_depth), x.floor(), y.floor(), mode="nearest")
        closer = (farthest - depth) / torch.maximum(farthest, depth).clamp(min=1e-12)
        covered = ((closer - self.config.depth_margin) / self.config.depth_ramp).clamp(0.0, 1.0)
        return past.on_screen * (1.0 - covered * (depth >= 0.0))

    def gather_past(
        self, history_color: Tensor, history_count: Tensor, exposure: Tensor, past: Past, surface: Tensor
    ) -> Remembered:
        """Warp the history; samples of another surface do not count."""
        warped = quarantine(read_catmull_rom(history_color, past.x, past.y), 0.0)
        count = read(history_count, past.x, past.y) * surface
        speed = squared_length(past.motion).sqrt()
        return Remembered(ycocg(tone(warped * exposure)), count, speed)

    def network(self, present: Present, past: Remembered) -> Blend:
        """Decide by rules what a learned method decides by a network."""
        c = self.config
        gamma = ramp(past.speed, c.gamma_still, c.gamma_moving, c.gamma_speed)
        box = variance_box(present.first, present.second, gamma)
        inside = clip_to_center(past.color, box)
        rectified = inside + c.kept_outside * (past.color - inside)
        remains = 1.0 - (c.forget * (overshoot(past.color, box) - 1.0)).clamp(0.0, 1.0)
        limit = ramp(past.speed, c.count_still, c.count_moving, c.count_speed)
        count = torch.minimum(past.samples * remains, limit)
        weight = present.confidence / (count + present.confidence).clamp(min=1e-6)
        return Blend(rectified, weight, count + present.confidence, count.clamp(max=1.0))

    def finish(self, present: Present, blend: Blend, exposure: Tensor) -> Tensor:
        """Average, fall back on this frame where little is known, go back to linear RGB."""
        sample = present.frame + blend.settled * (present.sample - present.frame)
        color = blend.past + blend.weight * (sample - blend.past)
        color = torch.where(blend.settled > 1e-3, color, present.frame)
        return bounded(inverse_tone(from_ycocg(color).clamp(min=0.0)) / exposure)


def ramp(speed: Tensor, still: float, moving: float, fast: float) -> Tensor:
    """`still` at rest, `moving` from `fast` on, linear between."""
    return still + (moving - still) * (speed / fast).clamp(max=1.0)


def farthest_of_four(depth: Tensor) -> Tensor:
    """Smallest reversed depth of each pixel and its right, lower and lower right neighbours."""
    right = torch.minimum(depth, torch.cat([depth[..., 1:], depth[..., -1:]], dim=3))
    return torch.minimum(right, torch.cat([right[:, :, 1:], right[:, :, -1:]], dim=2))
