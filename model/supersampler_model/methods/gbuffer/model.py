"""`gbuffer`: supersampling with G-buffers of display size (Wang et al. 2025).

What a surface reflects is known of every display pixel; what light it reflects, of a few samples. Samples
are divided by what their own surface reflects, brought to the display pixels whose surface is like theirs,
and multiplied by what those reflect: textures and edges are there in the first frame. The paper's network,
which reads the G-buffers, this frame and two of the past, then says how that is weighed against its
neighbours and against the picture of the frame before, which smooths what one sample a pixel cannot tell.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from supersampler.methods.gbuffer.spec import FRAME, GBUFFER, GBUFFER_4X, GBufferConfig, GBufferNetworkConfig
from supersampler.methods.spec import DISPLAY, RENDER, Shape
from supersampler_model.methods.base import (
    Fused,
    display_size_of,
    render_size_of,
)
from supersampler_model.methods.gbuffer.buffers import (
    Finished,
    Gathered,
    History,
    Present,
    Remembered,
    Surfaces,
)
from supersampler_model.methods.gbuffer.network import (
    BESIDE,
    COLORS,
    CURRENT,
    GRADIENTS,
    SAMPLES,
    SURFACES,
    GBufferNetwork,
    Seen,
)
from supersampler_model.methods.gbuffer.network_inputs import seen_of
from supersampler_model.methods.gbuffer.surfaces import (
    LEAST,
    Nearest,
    changed_light,
    motion_of_surface,
    nearest_past,
    reflectance,
    samples_of,
    usable_surfaces,
    weighed_mean,
)
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.color import bounded, exposure_for, inverse_tone, sanitize, tone, valid
from supersampler_model.ops.motion import (
    Past,
    covered,
    dilate_motion_2x2,
    past_of,
    read,
    read_cubic,
    usable_motion,
)
from supersampler_model.ops.sampling import (
    View,
    channels_of,
    gaussian,
    neighbours,
    normalised,
    pick,
    pick_first,
    sum_of,
    upsample,
)

TONED = 1.0 - 1e-4  # most of a toned colour
AROUND = (0.03, 0.12, 0.03, 0.12, 1.0, 0.12, 0.03, 0.12, 0.03)  # weights of neighbours, at first


class GBuffer(LearnedMethod):
    """Bring samples to where their surfaces are, then weigh."""

    spec: ClassVar = GBUFFER

    def __init__(self, config: GBufferConfig | None = None) -> None:
        super().__init__()
        self.config: GBufferConfig = config or self.spec.config()
        c = self.config
        self.net = GBufferNetwork(c.network, ratio=c.ratio, mixing=sum(c.parts))

    def fused(self) -> Fused | None:
        """All of figure 2."""
        of_display = {"surfaces": SURFACES, "gradients": GRADIENTS, "colors": COLORS}
        of_render = {"samples": SAMPLES, "beside": BESIDE, "beside_earlier": BESIDE}
        inputs: dict[str, Shape] = {
            name: (1, of_display[name], *DISPLAY)
            if name in of_display
            else (1, of_render.get(name, CURRENT), *RENDER)
            for name in Seen._fields
        }
        outputs = {"said": (1, sum(self.config.parts), *DISPLAY)}
        return Fused(self.net, inputs, outputs, self.config.ratio)

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """See `LearnedMethod`."""
        settings = dict(config)
        network = dict(settings.pop("network"))
        network |= {name: tuple(network[name]) for name in ("surfaces", "detailed", "levels")}
        return cls(cls.spec.config(network=GBufferNetworkConfig(**network), **settings))

    def forward(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        gbuffer_roughness: Tensor,  # (1, 1, h, w)
        gbuffer_metallic: Tensor,
        gbuffer_specular: Tensor,
        gbuffer_display_base_color: Tensor,  # (1, 3, H, W)
        gbuffer_display_normal: Tensor,  # (1, 3, H, W)
        gbuffer_display_roughness: Tensor,  # (1, 1, H, W)
        gbuffer_display_metallic: Tensor,
        gbuffer_display_specular: Tensor,
        gbuffer_display_depth: Tensor,
        history_color: Tensor,  # (1, 3, H, W)
        history_reflectance: Tensor,  # (1, 3, H, W)
        history_count: Tensor,  # (1, 1, H, W)
        history_frame: Tensor,  # (1, FRAME, h, w)
        history_frame_before: Tensor,  # (1, FRAME, h, w)
        history_motion: Tensor,  # (1, 2, h, w)
        history_jitter: Tensor,  # (1, 2)
        history_jitter_before: Tensor,  # (1, 2)
        history_exposure: Tensor,  # (1,)
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the history and the weight of the past."""
        render = Surfaces(
            gbuffer_base_color, gbuffer_normal, gbuffer_roughness, gbuffer_metallic, gbuffer_specular, depth
        )
        display = Surfaces(
            gbuffer_display_base_color,
            gbuffer_display_normal,
            gbuffer_display_roughness,
            gbuffer_display_metallic,
            gbuffer_display_specular,
            gbuffer_display_depth,
        )
        history = History(
            history_color,
            history_reflectance,
            history_count,
            history_frame,
            history_frame_before,
            history_motion,
            history_jitter,
            history_jitter_before,
            history_exposure,
        )
        view = View(display_size_of(display_size), render_size_of(color), jitter)
        return self.drawn(self.gather(color, motion, exposure, render, display, history, view), history)

    def drawn(self, gathered: Gathered, history: History) -> tuple[Tensor, ...]:
        """Return what `forward` does, of what was gathered."""
        (said,) = self.net(*gathered.seen)
        done = self.finish(gathered, said, history)
        return (done.image, *done.history, done.weight)

    @staticmethod
    def surfaces_of(gbuffer: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Surfaces of render size and of display size, of inputs by name."""
        of_display = {name: gbuffer[f"gbuffer_display_{name}"] for name in Surfaces._fields}
        of_render = {name: gbuffer[f"gbuffer_{name}"] for name in Surfaces._fields if name != "depth"}
        return Surfaces(**of_render, depth=depth), Surfaces(**of_display)

    def gather(
        self,
        color: Tensor,
        motion: Tensor,
        exposure: Tensor,
        render: Surfaces,
        display: Surfaces,
        history: History,
        view: View,
    ) -> Gathered:
        """Bring this frame and the past to where they are needed."""
        usable, color = valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, history.exposure)
        render, display, motion = usable_surfaces(render), usable_surfaces(display), usable_motion(motion)
        present = self.gather_present(color, usable, motion, render, display, view, followed)
        before = nearest_past(history.frame, motion, view.jitter - history.jitter)
        past = self.gather_past(present, history, self.gather_change(present, color, before))
        frame = torch.cat([color, render.depth, render.base_color, render.normal, usable], dim=1)
        seen = seen_of(present, past, before, history, masked=self.config.masked)
        return Gathered(seen, present, past, frame)

    def gather_present(
        self,
        color: Tensor,
        usable: Tensor,
        motion: Tensor,
        render: Surfaces,
        display: Surfaces,
        view: View,
        followed: Tensor,
    ) -> Present:
        """Bring the samples of this frame to the surfaces of the display."""
        c, grid, exposure = self.config, view.grid(render_size_of(color)), followed.abs()
        toned, reflected = tone(color * exposure) * usable, reflectance(display)
        light = tone(color * exposure / reflectance(render))
        samples = samples_of(light, usable, render, display, grid)
        marked = torch.cat([toned, usable], dim=1)
        near = upsample(marked, grid, gaussian(c.sample_sigma), (float(c.ratio), float(c.ratio)))
        smooth = normalised(upsample(marked, grid, gaussian(c.smooth_sigma))).clamp(0.0, TONED)
        return Present(
            toned=toned,
            usable=usable,
            motion=motion,
            render=render,
            display=display,
            reflectance=reflected,
            samples=samples,
            guided=_lit(weighed_mean(samples), reflected),
            smooth=smooth,
            near=(near[:, :3] + 1e-3 * smooth) / (near[:, 3:] + 1e-3),
            confidence=near[:, 3:].clamp(max=1.0),
            view=view,
            exposure=exposure,
            followed=followed,
        )

    def gather_change(self, present: Present, color: Tensor, before: Nearest) -> Tensor:
        """(1, 1, H, W) 1 where this frame's light says that the past is of no use, else 0."""
        known = present.usable * before.found[:, FRAME - 1 :] * before.on_screen
        past = sanitize(before.found[:, :3], 0.0)
        changed = changed_light(color * present.exposure, past * present.exposure, known)
        return pick(changed, present.view.grid(render_size_of(color)))

    def gather_past(self, present: Present, history: History, changed: Tensor) -> Remembered:
        """Warp the picture of the frame before; where light has `changed` there is none."""
        c, view, depth, motion = self.config, present.view, present.render.depth, present.motion
        render = render_size_of(depth)
        grid = view.grid(render)
        moved = motion_of_surface(depth, motion, present.display.depth, grid)
        own = past_of(moved, view.display, render)
        front = pick_first(torch.cat(dilate_motion_2x2(depth, motion), dim=1), grid)
        there = past_of(front[:, 1:], view.display, render)
        x, y = View(view.display, render, history.jitter).to_render(own.x, own.y)
        hidden = covered(present.display.depth, history.frame[:, 3:4], x, y, c.depth_margin, c.depth_ramp)
        before = read(history.reflectance, own.x, own.y).clamp(min=0.5 * LEAST)
        plain = sanitize(read(history.color, own.x, own.y), 0.0)
        relit = self._warped(history.color, own) / before * present.reflectance
        past = Remembered(
            color=_shown(self._warped(history.color, there) * present.exposure, there),
            own=_shown(plain * present.exposure, own),
            relit=_shown(relit * present.exposure, own),
            counted=read(history.counted, there.x, there.y) * there.on_screen * (1.0 - changed),
            surface=own.on_screen * (1.0 - 2.0 * hidden).clamp(min=0.0),
        )
        return past if c.blended else Remembered(*map(torch.zeros_like, past))

    def _warped(self, image: Tensor, past: Past) -> Tensor:
        sharp = read_cubic(image, past.x, past.y, self.config.history_sharpness)
        return sanitize(sharp, 0.0)

    def finish(self, gathered: Gathered, said: Tensor, history: History) -> Finished:
        """Weigh, count, and go back to linear RGB."""
        past, present, c = gathered.past, gathered.present, self.config
        weights, around, kernel = said.clamp(-12.0, 12.0).split_with_sizes(c.parts, dim=1)
        known = (past.counted > 0.0).float()
        kept = past.counted * past.surface
        relit = _lit(weighed_mean(present.samples, kernel), present.reflectance)
        confidence = present.confidence
        pasts = [
            (past.color, known * (kept + 1e-3)),
            (past.relit, known * (0.3 * kept + 1e-3)),
            (past.own, known * (0.1 * kept + 1e-3)),
        ]
        presents = [
            (_smoothed(present.guided, around), confidence + 0.3),
            (present.smooth, 0.1 * confidence + 0.01),
            (relit, 0.2 * confidence + 0.05),
            (present.near, 0.2 * confidence + 1e-3),
        ]
        begun = [weight for _, weight in (*pasts, *presents)]
        shares = [b * factor for b, factor in zip(begun, channels_of(weights.exp()), strict=True)]
        old, new = sum_of(shares[: len(pasts)]), sum_of(shares[len(pasts) :])
        total = old + new
        color = sum_of([s / total * v for s, (v, _) in zip(shares, (*pasts, *presents), strict=True)])
        image = bounded(inverse_tone(color) / present.exposure)
        odds = old / new * sum_of(begun[len(pasts) :])  # samples that the past was taken for
        count = torch.minimum(odds, past.counted).clamp(max=c.samples) + confidence
        left = History(
            image,
            present.reflectance,
            count,
            gathered.frame,
            history.frame * 1.0,
            present.motion,
            present.view.jitter * 1.0,
            history.jitter * 1.0,
            present.followed,
        )
        return Finished(image, left, old / total)


def _lit(light: Tensor, reflected: Tensor) -> Tensor:
    """Toned light on a surface, toned."""
    return tone(inverse_tone(light) * reflected).clamp(0.0, TONED)


def _shown(color: Tensor, past: Past) -> Tensor:
    """Toned; 0 off screen."""
    return (tone(color) * past.on_screen).clamp(0.0, TONED)


def _smoothed(image: Tensor, kernel: Tensor) -> Tensor:
    """Mean of each pixel and its neighbours; `kernel` is (1, 9, H, W), logarithms of factors to AROUND."""
    weights = [w * factor for w, factor in zip(AROUND, channels_of(kernel.exp()), strict=True)]
    total = sum_of(weights)
    return sum_of([w * pixel for w, pixel in zip(weights, neighbours(image), strict=True)]) / total


class GBuffer4(GBuffer):
    """At a ratio of 4."""

    spec: ClassVar = GBUFFER_4X
