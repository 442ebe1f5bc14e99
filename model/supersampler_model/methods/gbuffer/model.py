"""`gbuffer`: supersampling with G-buffers of display size (Wang et al. 2025).

The G-buffers give the reflectance of every display pixel; light is sampled once per render pixel. Each sample
is divided by the reflectance of its own surface, resampled at display pixels with similar surfaces, and
multiplied by their reflectance. Textures and edges are therefore complete in the first frame. The paper's
network reads the G-buffers, this frame and two previous frames. It infers the weights that blend the result
with its neighbours and with the previous image, which reduces the noise of one sample per pixel.
"""

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor

from supersampler.methods.gbuffer.spec import (
    FRAME,
    GBUFFER,
    GBUFFER_4X,
    GBUFFER_DEPTH,
    GBUFFER_SMALL,
    GBUFFER_SMALL_4X,
    GBufferConfig,
)
from supersampler.methods.spec import DISPLAY, RENDER, Shape
from supersampler_model.methods.base import Fused
from supersampler_model.methods.gbuffer import network
from supersampler_model.methods.gbuffer.buffers import (
    CurrentFrame,
    Finished,
    FrameInputs,
    Gathered,
    History,
    Surfaces,
    WarpedHistory,
)
from supersampler_model.methods.gbuffer.network_inputs import network_inputs
from supersampler_model.methods.gbuffer.surfaces import (
    MIN_REFLECTANCE,
    NearestSamples,
    changed_light,
    lit,
    motion_of_surface,
    neutral_surfaces,
    read_nearest,
    reflectance,
    samples_of,
    usable_surfaces,
    weighted_mean,
)
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.color import (
    TONED,
    bounded,
    exposure_for,
    inverse_tone,
    limited,
    sanitize,
    tone,
    valid,
)
from supersampler_model.ops.compositing import composite, reactive_at
from supersampler_model.ops.missing import filled
from supersampler_model.ops.motion import (
    Reprojection,
    dilate_motion_2x2,
    disocclusion,
    read_cubic,
    reproject,
    to_display,
    usable_motion,
)
from supersampler_model.ops.sampling import (
    View,
    gaussian,
    normalised,
    pick,
    pick_first_vector,
    sum_of,
    upsample,
)
from supersampler_model.ops.size import display_size_of, render_size_of
from supersampler_model.ops.windows import channels_of, neighbours_3x3

MOST_FACTOR: Mapping[torch.dtype, float] = {torch.float32: 12.0, torch.float16: 8.0}
"""Maximum of the logarithm of a factor, and minus its minimum: sums of nine such factors are half floats."""
FILLED = 1e-4  # weight of a sample that is missing, 1 of others
NEIGHBOUR_WEIGHTS = (0.03, 0.12, 0.03, 0.12, 1.0, 0.12, 0.03, 0.12, 0.03)
"""Initial weights of a pixel and its eight neighbours in the learned kernel, row by row."""


class GBuffer(LearnedMethod):
    """Resample light by surface similarity, then blend with the history."""

    spec: ClassVar = GBUFFER
    config: GBufferConfig
    net: network.GBufferNetwork
    in_half: ClassVar = True

    def make_network(self) -> network.GBufferNetwork:
        """Return the network of figure 2."""
        c = self.config
        return network.GBufferNetwork(c.network, ratio=c.ratio, blend_parameters=sum(c.parts))

    def fused(self) -> Fused | None:
        """Return the whole network; tensor names are those of released graphs."""
        channels = network.INPUT_CHANNELS
        inputs: dict[str, Shape] = {
            name: (1, count, *(DISPLAY if name in network.DISPLAY_INPUTS else RENDER))
            for name, count in channels.items()
        }
        outputs = {"blend_parameters": (1, sum(self.config.parts), *DISPLAY)}
        return Fused(self.net, inputs, outputs, self.config.ratio)

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        *others: Tensor,  # G-buffers in the order of `inputs`, then the history in the order of `history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the weight of the history."""
        names = [name for name in self.inputs() if name.startswith("gbuffer_")]
        render, display = self.surfaces_of(dict(zip(names, others, strict=False)), depth)
        history = History(*others[len(names) :])
        view = View(display_size_of(display_size), render_size_of(color), jitter)
        gathered = self.gather(FrameInputs(color, motion, exposure, render, display, view), history)
        mask = reactive_at(reactive, valid(color), view.grid(render_size_of(color)))
        gathered = gathered._replace(reactive=mask)
        (blend,) = self.net(*gathered.inputs)
        done = self.finish(gathered, blend, history)
        return (done.image, *done.history, done.weight)

    @staticmethod
    def surfaces_of(gbuffers: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Return the surfaces at render and at display size, from G-buffers by input name."""
        of_display = {name: gbuffers[f"gbuffer_display_{name}"] for name in Surfaces._fields}
        of_render = {name: gbuffers[f"gbuffer_{name}"] for name in Surfaces._fields if name != "depth"}
        return Surfaces(**of_render, depth=depth), Surfaces(**of_display)

    def gather(self, frame: FrameInputs, history: History) -> Gathered:
        """Resample this frame and the history for the network and the blend."""
        usable, color = valid(frame.color), sanitize(frame.color, 0.0)
        followed = exposure_for(color, usable, frame.exposure, history.exposure)
        frame = frame._replace(
            color=filled(color, usable, followed.abs()),
            motion=usable_motion(frame.motion),
            exposure=followed.abs(),
            render=usable_surfaces(frame.render, self.dtype),
            display=usable_surfaces(frame.display, self.dtype),
        )
        current = self.gather_current(frame, usable, followed)
        before = read_nearest(history.frame, frame.motion, frame.view.jitter - history.jitter)
        warped = self.gather_history(current, history, self.gather_change(current, before))
        render = frame.render
        surface = render.base_color.float(), render.normal.float()
        stored = torch.cat([color, render.depth, *surface, usable], dim=1)
        inputs = network_inputs(current, warped, before, history, masked=self.config.masked)
        return Gathered(inputs, current, warped, stored)

    def gather_current(self, frame: FrameInputs, usable: Tensor, followed: Tensor) -> CurrentFrame:
        """Resample this frame at the display pixels, weighted by surface similarity.

        Args:
            frame: sanitized, with the exposure to use.
            usable: (1, 1, h, w) 1 where the colour was valid, else 0.
            followed: (1,) see `CurrentFrame`.
        """
        c, exposed = self.config, frame.color * frame.exposure
        grid = frame.view.grid(render_size_of(exposed))
        toned, reflected = tone(exposed), reflectance(frame.display)
        counted = usable.clamp(min=FILLED)  # what is filled shows where there is nothing else
        light = limited(tone(exposed / reflectance(frame.render)).to(self.dtype))
        samples = samples_of(light, counted, frame.render, frame.display, grid)
        colors = torch.cat([toned * counted, counted], dim=1).to(self.dtype)
        near = upsample(colors, grid, gaussian(c.sample_sigma), (float(c.ratio), float(c.ratio)))
        smooth = normalised(upsample(colors, grid, gaussian(c.smooth_sigma))).clamp(0.0, TONED[self.dtype])
        return CurrentFrame(
            toned=toned * usable,
            usable=usable,
            inputs=frame,
            reflectance=reflected,
            samples=samples,
            guided=lit(weighted_mean(samples), reflected),
            smooth=smooth,
            near=limited((near[:, :3] + 1e-3 * smooth) / (near[:, 3:] + 1e-3)),
            confidence=near[:, 3:].clamp(max=1.0),
            followed=followed,
        )

    def gather_change(self, current: CurrentFrame, before: NearestSamples) -> Tensor:
        """Return (1, 1, H, W) 1 where the light changed so much that the history is invalid, else 0."""
        inputs = current.inputs
        known = current.usable * before.values[:, FRAME - 1 :] * before.on_screen
        color_before = sanitize(before.values[:, :3], 0.0)
        changed = changed_light(inputs.color * inputs.exposure, color_before * inputs.exposure, known)
        return pick(changed, inputs.view.grid(render_size_of(inputs.color)))

    def gather_history(self, current: CurrentFrame, history: History, changed: Tensor) -> WarpedHistory:
        """Warp the previous image; its sample count is 0 where the light has `changed`."""
        c, inputs, view = self.config, current.inputs, current.inputs.view
        depth, motion, exposure = inputs.render.depth, inputs.motion, inputs.exposure
        render = render_size_of(depth)
        grid = view.grid(render)
        own_motion = motion_of_surface(depth, motion, inputs.display.depth, grid)
        own = reproject(to_display(own_motion, view.display, render), view.display, grid)
        _, dilated = dilate_motion_2x2(depth, motion)
        vectors = pick_first_vector(to_display(dilated, view.display, render), grid)
        front = reproject(vectors, view.display, grid)
        before = View(view.display, render, history.jitter).to_render(own.position)
        occluded = disocclusion(
            inputs.display.depth, history.frame[:, 3:4], before, c.depth_margin, c.depth_ramp
        )
        reflectance_before = own.read(history.reflectance).clamp(min=0.5 * MIN_REFLECTANCE)
        bilinear = sanitize(own.read(history.color), 0.0)
        relit = self._cubic(history.color, own) / reflectance_before * current.reflectance
        count = front.read(history.sample_count)
        warped = WarpedHistory(
            color=_toned(self._cubic(history.color, front) * exposure, front),
            own=_toned(bilinear * exposure, own),
            relit=_toned(relit * exposure, own),
            sample_count=count * front.on_screen * (1.0 - changed),
            surface=own.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0),
        )
        return warped if c.blended else WarpedHistory(*map(torch.zeros_like, warped))

    def _cubic(self, image: Tensor, place: Reprojection) -> Tensor:
        return sanitize(read_cubic(image, place.position, self.config.history_sharpness), 0.0)

    def finish(self, gathered: Gathered, blend: Tensor, history: History) -> Finished:
        """Blend, update the sample count, and return to linear RGB."""
        warped, current, c = gathered.warped, gathered.current, self.config
        most = MOST_FACTOR[blend.dtype]
        factors, around, kernel = blend.clamp(-most, most).split_with_sizes(c.parts, dim=1)
        known = (warped.sample_count > 0.0).float()
        kept = warped.sample_count * warped.surface
        guided = lit(weighted_mean(current.samples, kernel), current.reflectance)
        confidence = current.confidence.float()
        history_colors = [
            (warped.color, known * (kept + 1e-3)),
            (warped.relit, known * (0.3 * kept + 1e-3)),
            (warped.own, known * (0.1 * kept + 1e-3)),
        ]
        current_colors = [
            (limited(_smoothed(current.guided, around)), confidence + 0.3),
            (current.smooth, 0.1 * confidence + 0.01),
            (guided, 0.2 * confidence + 0.05),
            (current.near, 0.2 * confidence + 1e-3),
        ]
        color, weight, odds = composite(
            history_colors, current_colors, factors, gathered.reactive, current.smooth
        )
        image = bounded(inverse_tone(color) / current.inputs.exposure)
        next_history = History(
            color=image,
            reflectance=current.reflectance.float(),
            sample_count=torch.minimum(odds, warped.sample_count).clamp(max=c.samples) + confidence,
            frame=gathered.frame,
            frame_before=history.frame * 1.0,
            motion=current.inputs.motion,
            jitter=current.inputs.view.jitter * 1.0,
            jitter_before=history.jitter * 1.0,
            exposure=current.followed,
        )
        return Finished(image, next_history, weight)


def _toned(color: Tensor, place: Reprojection) -> Tensor:
    """Apply the tone curve; 0 off screen."""
    return (tone(color) * place.on_screen).clamp(0.0, TONED[torch.float32])


def _smoothed(image: Tensor, kernel: Tensor) -> Tensor:
    """Average each pixel and its neighbours.

    Args:
        image: (1, 3, H, W).
        kernel: (1, 9, H, W) logarithms of factors to NEIGHBOUR_WEIGHTS.
    """
    weights = [w * factor for w, factor in zip(NEIGHBOUR_WEIGHTS, channels_of(kernel.exp()), strict=True)]
    total = sum_of(weights)
    return sum_of([w * pixel for w, pixel in zip(weights, neighbours_3x3(image), strict=True)]) / total


class GBuffer4(GBuffer):
    """`GBuffer` at a ratio of 4."""

    spec: ClassVar = GBUFFER_4X


class SmallGBuffer(GBuffer):
    """`gbuffer-small`: narrow separable convolutions, for CPUs and small GPUs."""

    spec: ClassVar = GBUFFER_SMALL


class SmallGBuffer4(GBuffer):
    """`SmallGBuffer` at a ratio of 4."""

    spec: ClassVar = GBUFFER_SMALL_4X


class DepthGBuffer(GBuffer):
    """`gbuffer-depth`: `SmallGBuffer` for forward renderers; display-size depth is the only G-buffer."""

    spec: ClassVar = GBUFFER_DEPTH

    @staticmethod
    def surfaces_of(gbuffers: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Return surfaces of which only the depth is known."""
        return neutral_surfaces(depth), neutral_surfaces(gbuffers["gbuffer_display_depth"])
