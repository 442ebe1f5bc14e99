"""`gbuffer`: supersampling with G-buffers of display size (Wang et al. 2025).

The reflectance of every display pixel is known from the G-buffers; the light is known at a few samples.
Samples are divided by the reflectance of their own surface, resampled at display pixels with similar
surfaces, and multiplied by the reflectance there: textures and edges are complete in the first frame. The
paper's network reads the G-buffers, this frame and two previous frames, and infers how to blend that with its
neighbours and with the previous image, which reduces the noise of one sample per pixel.
"""

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor

from supersampler.methods.gbuffer.spec import FRAME, GBUFFER, GBUFFER_4X, GBufferConfig
from supersampler.methods.spec import DISPLAY, RENDER, Shape
from supersampler_model.methods.base import (
    Fused,
    display_size_of,
    render_size_of,
)
from supersampler_model.methods.gbuffer.buffers import (
    CurrentFrame,
    Finished,
    Gathered,
    History,
    Surfaces,
    WarpedHistory,
)
from supersampler_model.methods.gbuffer.network import (
    COLORS,
    CURRENT,
    GRADIENTS,
    REFINER_INPUTS,
    SAMPLES,
    SURFACES,
    GBufferNetwork,
    NetworkInputs,
)
from supersampler_model.methods.gbuffer.network_inputs import network_inputs
from supersampler_model.methods.gbuffer.surfaces import (
    LEAST,
    Nearest,
    changed_light,
    motion_of_surface,
    read_nearest,
    reflectance,
    samples_of,
    usable_surfaces,
    weighed_mean,
)
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.color import bounded, exposure_for, inverse_tone, sanitize, tone, valid
from supersampler_model.ops.compositing import composite
from supersampler_model.ops.motion import (
    Reprojection,
    dilate_motion_2x2,
    disocclusion,
    read,
    read_cubic,
    reproject,
    usable_motion,
)
from supersampler_model.ops.sampling import (
    View,
    channels_of,
    gaussian,
    neighbours_3x3,
    normalised,
    pick,
    pick_first,
    sum_of,
    upsample,
)

TONED = 1.0 - 1e-4  # maximum of a toned colour
AROUND = (
    0.03,
    0.12,
    0.03,
    0.12,
    1.0,
    0.12,
    0.03,
    0.12,
    0.03,
)  # initial weights of a pixel and its neighbours


class GBuffer(LearnedMethod):
    """Resample light by surface similarity, then blend with the history."""

    spec: ClassVar = GBUFFER
    config: GBufferConfig
    net: GBufferNetwork

    def make_network(self) -> GBufferNetwork:
        """Return the network of figure 2."""
        c = self.config
        return GBufferNetwork(c.network, ratio=c.ratio, blend_parameters=sum(c.parts))

    def fused(self) -> Fused | None:
        """All of figure 2; tensor names are those of released graphs."""
        of_display = {"surfaces": SURFACES, "gradients": GRADIENTS, "colors": COLORS}
        of_render = {
            "samples": SAMPLES,
            "refiner_inputs": REFINER_INPUTS,
            "earlier_refiner_inputs": REFINER_INPUTS,
        }
        inputs: dict[str, Shape] = {
            name: (1, of_display[name], *DISPLAY)
            if name in of_display
            else (1, of_render.get(name, CURRENT), *RENDER)
            for name in NetworkInputs._fields
        }
        outputs = {"blend_parameters": (1, sum(self.config.parts), *DISPLAY)}
        return Fused(self.net, inputs, outputs, self.config.ratio)

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
        *history: Tensor,  # as in `GBuffer.history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the weight of the history."""
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
        view = View(display_size_of(display_size), render_size_of(color), jitter)
        return self.step_outputs(color, motion, exposure, render, display, History(*history), view)

    def step_outputs(
        self,
        color: Tensor,
        motion: Tensor,
        exposure: Tensor,
        render: Surfaces,
        display: Surfaces,
        history: History,
        view: View,
    ) -> tuple[Tensor, ...]:
        """Return the results of `forward`; the parameters are those of `gather`."""
        gathered = self.gather(color, motion, exposure, render, display, history, view)
        (blend,) = self.net(*gathered.inputs)
        done = self.finish(gathered, blend, history)
        return (done.image, *done.history, done.weight)

    @staticmethod
    def surfaces_of(gbuffer: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Return the surfaces at render and at display size, from inputs by name."""
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
        """Resample this frame and the history for the network and the blend."""
        usable, color = valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, history.exposure)
        render, display, motion = usable_surfaces(render), usable_surfaces(display), usable_motion(motion)
        current = self.gather_current(color, usable, motion, render, display, view, followed)
        before = read_nearest(history.frame, motion, view.jitter - history.jitter)
        warped = self.gather_history(current, history, self.gather_change(current, color, before))
        frame = torch.cat([color, render.depth, render.base_color, render.normal, usable], dim=1)
        inputs = network_inputs(current, warped, before, history, masked=self.config.masked)
        return Gathered(inputs, current, warped, frame)

    def gather_current(
        self,
        color: Tensor,
        usable: Tensor,
        motion: Tensor,
        render: Surfaces,
        display: Surfaces,
        view: View,
        followed: Tensor,
    ) -> CurrentFrame:
        """Resample this frame at display pixels by surface similarity."""
        c, grid, exposure = self.config, view.grid(render_size_of(color)), followed.abs()
        toned, reflected = tone(color * exposure) * usable, reflectance(display)
        light = tone(color * exposure / reflectance(render))
        samples = samples_of(light, usable, render, display, grid)
        marked = torch.cat([toned, usable], dim=1)
        near = upsample(marked, grid, gaussian(c.sample_sigma), (float(c.ratio), float(c.ratio)))
        smooth = normalised(upsample(marked, grid, gaussian(c.smooth_sigma))).clamp(0.0, TONED)
        return CurrentFrame(
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

    def gather_change(self, current: CurrentFrame, color: Tensor, before: Nearest) -> Tensor:
        """(1, 1, H, W) 1 where the lighting changed so much that the history is invalid, else 0."""
        known = current.usable * before.found[:, FRAME - 1 :] * before.on_screen
        color_before = sanitize(before.found[:, :3], 0.0)
        changed = changed_light(color * current.exposure, color_before * current.exposure, known)
        return pick(changed, current.view.grid(render_size_of(color)))

    def gather_history(self, current: CurrentFrame, history: History, changed: Tensor) -> WarpedHistory:
        """Warp the previous image; its count is 0 where the light has `changed`."""
        c, view, depth, motion = self.config, current.view, current.render.depth, current.motion
        render = render_size_of(depth)
        grid = view.grid(render)
        moved = motion_of_surface(depth, motion, current.display.depth, grid)
        own = reproject(moved, view.display, render)
        front = pick_first(torch.cat(dilate_motion_2x2(depth, motion), dim=1), grid)
        front_place = reproject(front[:, 1:], view.display, render)
        x, y = View(view.display, render, history.jitter).to_render(own.x, own.y)
        occluded = disocclusion(
            current.display.depth, history.frame[:, 3:4], x, y, c.depth_margin, c.depth_ramp
        )
        reflectance_before = read(history.reflectance, own.x, own.y).clamp(min=0.5 * LEAST)
        plain = sanitize(read(history.color, own.x, own.y), 0.0)
        relit = self._warped(history.color, own) / reflectance_before * current.reflectance
        warped = WarpedHistory(
            color=_shown(self._warped(history.color, front_place) * current.exposure, front_place),
            own=_shown(plain * current.exposure, own),
            relit=_shown(relit * current.exposure, own),
            counted=read(history.counted, front_place.x, front_place.y)
            * front_place.on_screen
            * (1.0 - changed),
            surface=own.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0),
        )
        return warped if c.blended else WarpedHistory(*map(torch.zeros_like, warped))

    def _warped(self, image: Tensor, place: Reprojection) -> Tensor:
        sharp = read_cubic(image, place.x, place.y, self.config.history_sharpness)
        return sanitize(sharp, 0.0)

    def finish(self, gathered: Gathered, blend: Tensor, history: History) -> Finished:
        """Blend, update the count, and return to linear RGB."""
        warped, current, c = gathered.warped, gathered.current, self.config
        factors, around, kernel = blend.clamp(-12.0, 12.0).split_with_sizes(c.parts, dim=1)
        known = (warped.counted > 0.0).float()
        kept = warped.counted * warped.surface
        relit = _lit(weighed_mean(current.samples, kernel), current.reflectance)
        confidence = current.confidence
        history_colors = [
            (warped.color, known * (kept + 1e-3)),
            (warped.relit, known * (0.3 * kept + 1e-3)),
            (warped.own, known * (0.1 * kept + 1e-3)),
        ]
        current_colors = [
            (_smoothed(current.guided, around), confidence + 0.3),
            (current.smooth, 0.1 * confidence + 0.01),
            (relit, 0.2 * confidence + 0.05),
            (current.near, 0.2 * confidence + 1e-3),
        ]
        color, weight, odds = composite(history_colors, current_colors, factors)
        image = bounded(inverse_tone(color) / current.exposure)
        count = torch.minimum(odds, warped.counted).clamp(max=c.samples) + confidence
        next_history = History(
            image,
            current.reflectance,
            count,
            gathered.frame,
            history.frame * 1.0,
            current.motion,
            current.view.jitter * 1.0,
            history.jitter * 1.0,
            current.followed,
        )
        return Finished(image, next_history, weight)


def _lit(light: Tensor, reflected: Tensor) -> Tensor:
    """Toned light times reflectance, toned."""
    return tone(inverse_tone(light) * reflected).clamp(0.0, TONED)


def _shown(color: Tensor, place: Reprojection) -> Tensor:
    """Tone; 0 off screen."""
    return (tone(color) * place.on_screen).clamp(0.0, TONED)


def _smoothed(image: Tensor, kernel: Tensor) -> Tensor:
    """Mean of each pixel and its neighbours; `kernel` is (1, 9, H, W) logarithms of factors to AROUND."""
    weights = [w * factor for w, factor in zip(AROUND, channels_of(kernel.exp()), strict=True)]
    total = sum_of(weights)
    return sum_of([w * pixel for w, pixel in zip(weights, neighbours_3x3(image), strict=True)]) / total


class GBuffer4(GBuffer):
    """`GBuffer` at a ratio of 4."""

    spec: ClassVar = GBUFFER_4X
