"""`gbuffer`: supersampling with G-buffers of display size (Wang et al. 2025).

The G-buffers give the reflectance of every display pixel; light is sampled once per render pixel. Each sample
is divided by the reflectance of its own surface, resampled at display pixels with similar surfaces, and
multiplied by their reflectance. Textures and edges are therefore complete in the first frame. The network of
the paper reads the G-buffers, this frame and two previous frames. It infers the weights that blend the result
with its neighbours and with the previous image. This reduces the noise of one sample per pixel.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.gbuffer import spec as gbuffer
from supersampler.methods.spec import DISPLAY, RENDER, Shape
from supersampler_model import ops
from supersampler_model.methods import gbuffer_network as network
from supersampler_model.methods import gbuffer_surfaces as surfaces
from supersampler_model.methods.base import LearnedMethod, NetworkSubgraph
from supersampler_model.methods.gbuffer_network import NetworkInputs
from supersampler_model.methods.gbuffer_surfaces import NearestSamples, Samples, Surfaces

MAX_FACTOR: Mapping[torch.dtype, float] = {torch.float32: 12.0, torch.float16: 8.0}
"""Maximum absolute logarithm of a factor: half floats can represent sums of nine such factors."""
FILLED = 1e-4  # weight of a missing sample, which is filled; 1 of others
MOTION_UNIT = 8.0  # render pixels per unit of the motion inputs
PREVIOUS_NORMAL = slice(13, 16)  # channels of `NetworkInputs.refiner_inputs`: normals of the previous frame


class FrameInputs(NamedTuple):
    """The inputs of one frame."""

    color: Tensor  # (1, 3, h, w) linear RGB
    motion: Tensor  # (1, 2, h, w) render pixels, previous minus current
    exposure: Tensor  # (1,) 0: measure
    render: Surfaces
    display: Surfaces
    view: ops.View


class CurrentFrame(NamedTuple):
    """This frame, sanitized and resampled at the display pixels."""

    toned: Tensor  # (1, 3, h, w) exposed colour after the tone curve; 0 where it is not usable
    usable: Tensor  # (1, 1, h, w) 1 where the colour is valid, else 0
    inputs: FrameInputs  # sanitized, with the exposure to use
    reflectance: Tensor  # (1, 3, H, W) of the display pixels' surfaces
    samples: Samples
    guided: Tensor  # (1, 3, H, W) weighted mean of `samples` times the pixel's reflectance, toned
    smooth: Tensor  # (1, 3, H, W) mean colour under a wide Gaussian, toned
    near: Tensor  # (1, 3, H, W) mean colour under a narrow Gaussian, toned; its average over frames is sharp
    confidence: Tensor  # (1, 1, H, W) sum of the weights of `near`, [0, 1]
    followed: Tensor  # (1,) signed exposure for the history, see `exposure_for`


class WarpedHistory(NamedTuple):
    """The warped history at display size; colours are toned RGB."""

    color: Tensor  # (1, 3, H, W) warped by the dilated motion
    undilated: Tensor  # (1, 3, H, W) warped by the pixel's own motion
    relit: Tensor  # (1, 3, H, W) `undilated` over the previous reflectance, times the current one
    sample_count: Tensor  # (1, 1, H, W) number of accumulated samples; 0 without history
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible


class History(NamedTuple):
    """The history tensors; shapes as in `GBuffer.history`."""

    color: Tensor
    reflectance: Tensor
    sample_count: Tensor
    frame: Tensor
    frame_before: Tensor
    motion: Tensor
    jitter: Tensor
    jitter_before: Tensor
    exposure: Tensor


class Gathered(NamedTuple):
    """Results of the gather stage."""

    inputs: NetworkInputs
    current: CurrentFrame
    warped: WarpedHistory
    frame: Tensor  # (1, FRAME, h, w) the channels of this frame that the history stores
    reactive: Tensor = torch.zeros(())  # (1, 1, H, W) of `reactive_at`

    @property
    def previous_normal(self) -> Tensor:
        """(1, 3, h, w) warped normals of the previous frame; 0 where they are masked."""
        return self.inputs.refiner_inputs[:, PREVIOUS_NORMAL]


class Finished(NamedTuple):
    """Results of the finish stage."""

    image: Tensor  # (1, 3, H, W) linear RGB
    history: History
    weight: Tensor  # (1, 1, H, W) weight of the history in the image


class GBuffer(LearnedMethod):
    """Resample light by surface similarity, then blend with the history."""

    spec: ClassVar = gbuffer.GBUFFER
    config: gbuffer.GBufferConfig
    net: network.GBufferNetwork
    runs_in_fp16: ClassVar = True

    def make_network(self) -> network.GBufferNetwork:
        """Return the network of figure 2."""
        c = self.config
        return network.GBufferNetwork(c.network, ratio=c.ratio, blend_parameters=sum(c.parts))

    def subgraph(self) -> NetworkSubgraph | None:
        """Return the whole network, with the tensor names of released graphs."""
        channels = network.INPUT_CHANNELS
        inputs: dict[str, Shape] = {
            name: (1, count, *(DISPLAY if name in network.DISPLAY_INPUTS else RENDER))
            for name, count in channels.items()
        }
        outputs = {"blend_parameters": (1, sum(self.config.parts), *DISPLAY)}
        return NetworkSubgraph(self.net, inputs, outputs, self.config.ratio)

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
        view = ops.View(ops.display_size_of(display_size), ops.size_of(color), jitter)
        gathered = self.gather(FrameInputs(color, motion, exposure, render, display, view), history)
        mask = ops.reactive_at(reactive, ops.valid(color), view.grid(ops.size_of(color)))
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
        usable, color = ops.valid(frame.color), ops.sanitize(frame.color, 0.0)
        followed = ops.exposure_for(color, usable, frame.exposure, history.exposure)
        frame = frame._replace(
            color=ops.filled(color, usable, followed.abs()),
            motion=ops.usable_motion(frame.motion),
            exposure=followed.abs(),
            render=surfaces.usable_surfaces(frame.render, self.dtype),
            display=surfaces.usable_surfaces(frame.display, self.dtype),
        )
        current = self.gather_current(frame, usable, followed)
        before = surfaces.read_nearest(history.frame, frame.motion, frame.view.jitter - history.jitter)
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
        grid = frame.view.grid(ops.size_of(exposed))
        toned, reflected = ops.tone(exposed), surfaces.reflectance(frame.display)
        counted = usable.clamp(min=FILLED)  # filled samples show only where there are no others
        light = ops.limited(ops.tone(exposed / surfaces.reflectance(frame.render)).to(self.dtype))
        samples = surfaces.samples_of(light, counted, frame.render, frame.display, grid)
        colors = torch.cat([toned * counted, counted], dim=1).to(self.dtype)
        near = grid.upsample(colors, ops.gaussian(c.sample_sigma), (float(c.ratio), float(c.ratio)))
        smooth = ops.normalised(grid.upsample(colors, ops.gaussian(c.smooth_sigma))).clamp(
            0.0, ops.TONED[self.dtype]
        )
        return CurrentFrame(
            toned=toned * usable,
            usable=usable,
            inputs=frame,
            reflectance=reflected,
            samples=samples,
            guided=surfaces.lit(surfaces.weighted_mean(samples), reflected),
            smooth=smooth,
            near=ops.limited((near[:, :3] + 1e-3 * smooth) / (near[:, 3:] + 1e-3)),
            confidence=near[:, 3:].clamp(max=1.0),
            followed=followed,
        )

    def gather_change(self, current: CurrentFrame, before: NearestSamples) -> Tensor:
        """Return (1, 1, H, W): 1 where the light changed so much that the history is invalid, else 0."""
        inputs = current.inputs
        known = current.usable * before.values[:, gbuffer.FRAME - 1 :] * before.on_screen
        color_before = ops.sanitize(before.values[:, :3], 0.0)
        now, then = (color * inputs.exposure for color in (inputs.color, color_before))
        changed = surfaces.changed_light(now, then, known)
        return inputs.view.grid(ops.size_of(inputs.color)).pick(changed)

    def gather_history(self, current: CurrentFrame, history: History, changed: Tensor) -> WarpedHistory:
        """Warp the previous image; the sample count becomes 0 where the light has `changed`."""
        c, inputs, view = self.config, current.inputs, current.inputs.view
        depth, motion, exposure = inputs.render.depth, inputs.motion, inputs.exposure
        render = ops.size_of(depth)
        grid = view.grid(render)
        own_motion = surfaces.motion_of_surface(depth, motion, inputs.display.depth, grid)
        by_own = ops.reproject(ops.to_display(own_motion, view.display, render), view.display, grid)
        _, dilated = ops.dilate_motion_2x2(depth, motion)
        vectors = grid.pick_first_vectors(ops.to_display(dilated, view.display, render))
        by_dilated = ops.reproject(vectors, view.display, grid)
        before = ops.View(view.display, render, history.jitter).to_render(by_own.position)
        occluded = ops.disocclusion(
            inputs.display.depth, history.frame[:, 3:4], before, c.depth_margin, c.depth_ramp
        )
        reflectance_before = by_own.read(history.reflectance).clamp(min=0.5 * surfaces.MIN_REFLECTANCE)
        bilinear = ops.sanitize(by_own.read(history.color), 0.0)
        cubic, dilated_cubic = (
            ops.sanitize(ops.read_cubic(history.color, place.position, c.history_sharpness), 0.0)
            for place in (by_own, by_dilated)
        )
        relit = cubic / reflectance_before * current.reflectance
        count = by_dilated.read(history.sample_count)
        warped = WarpedHistory(
            color=_toned(dilated_cubic * exposure, by_dilated),
            undilated=_toned(bilinear * exposure, by_own),
            relit=_toned(relit * exposure, by_own),
            sample_count=count * by_dilated.on_screen * (1.0 - changed),
            surface=by_own.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0),
        )
        return warped if c.blended else WarpedHistory(*map(torch.zeros_like, warped))

    def finish(self, gathered: Gathered, blend: Tensor, history: History) -> Finished:
        """Blend, convert to linear RGB, and update the sample count."""
        warped, current, c = gathered.warped, gathered.current, self.config
        limit = MAX_FACTOR[blend.dtype]
        factors, around, kernel = blend.clamp(-limit, limit).split_with_sizes(c.parts, dim=1)
        known = (warped.sample_count > 0.0).float()
        kept = warped.sample_count * warped.surface
        guided = surfaces.lit(surfaces.weighted_mean(current.samples, kernel), current.reflectance)
        confidence = current.confidence.float()
        history_colors = [
            (warped.color, known * (kept + 1e-3)),
            (warped.relit, known * (0.3 * kept + 1e-3)),
            (warped.undilated, known * (0.1 * kept + 1e-3)),
        ]
        current_colors = [
            (ops.limited(_smoothed(current.guided, around)), confidence + 0.3),
            (current.smooth, 0.1 * confidence + 0.01),
            (guided, 0.2 * confidence + 0.05),
            (current.near, 0.2 * confidence + 1e-3),
        ]
        color, weight, odds = ops.composite(
            history_colors, current_colors, factors, gathered.reactive, current.smooth
        )
        image = ops.bounded(ops.inverse_tone(color) / current.inputs.exposure)
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


def _toned(color: Tensor, place: ops.Reprojection) -> Tensor:
    """Apply the tone curve; 0 off screen."""
    return (ops.tone(color) * place.on_screen).clamp(0.0, ops.TONED[torch.float32])


def _smoothed(image: Tensor, kernel: Tensor) -> Tensor:
    """Average each pixel and its neighbours; `kernel` holds logarithms of factors to NEIGHBOUR_WEIGHTS."""
    weights = [
        w * factor for w, factor in zip(gbuffer.NEIGHBOUR_WEIGHTS, ops.channels_of(kernel.exp()), strict=True)
    ]
    total = ops.sum_of(weights)
    terms = [w * pixel for w, pixel in zip(weights, ops.neighbours_3x3(image), strict=True)]
    return ops.sum_of(terms) / total


class GBuffer4(GBuffer):
    """`GBuffer` at a ratio of 4."""

    spec: ClassVar = gbuffer.GBUFFER_4X


class SmallGBuffer(GBuffer):
    """`gbuffer-small`: narrow separable convolutions, for CPUs and small GPUs."""

    spec: ClassVar = gbuffer.GBUFFER_SMALL


class SmallGBuffer4(GBuffer):
    """`SmallGBuffer` at a ratio of 4."""

    spec: ClassVar = gbuffer.GBUFFER_SMALL_4X


def network_inputs(
    current: CurrentFrame, warped: WarpedHistory, before: NearestSamples, history: History, *, masked: bool
) -> NetworkInputs:
    """Compute the network inputs, in the type of the surfaces; `before` are samples of the previous frame."""
    _, motion, _, render, display, view = current.inputs
    dtype = display.base_color.dtype
    depth = surfaces.relative_depth(render.depth, surfaces.closest_around(render.depth))
    jitter = view.jitter[:, :, None, None].expand_as(motion)
    display_depth = surfaces.relative_depth(display.depth, surfaces.closest_around(display.depth))
    two_frames = motion + surfaces.read_bilinear(history.motion, motion, view.jitter - history.jitter)
    previous, refiner_inputs = _warped(current, before, motion, masked=masked)
    earlier_samples = surfaces.read_nearest(
        history.frame_before, two_frames, view.jitter - history.jitter_before
    )
    earlier, earlier_refiner_inputs = _warped(current, earlier_samples, two_frames, masked=masked)
    colors = [
        current.guided,
        current.near - current.guided,
        warped.color - current.guided,
        warped.relit - current.guided,
        warped.sample_count / (warped.sample_count + 4.0),
        warped.surface,
        current.samples.similarity.clamp(max=1.0),
    ]
    return NetworkInputs(
        surfaces=torch.cat([*display[:5], display_depth.to(dtype)], dim=1),
        gradients=surfaces.gradients(display),
        current=torch.cat([current.toned, depth, jitter], dim=1).to(dtype),
        previous=previous,
        refiner_inputs=refiner_inputs,
        earlier=earlier,
        earlier_refiner_inputs=earlier_refiner_inputs,
        samples=torch.cat([_scaled(motion), jitter, current.usable, depth], dim=1).to(dtype),
        colors=torch.cat([color.to(dtype) for color in colors], dim=1),
    )


def _warped(
    current: CurrentFrame, nearest: NearestSamples, motion: Tensor, *, masked: bool
) -> tuple[Tensor, Tensor]:
    """Return a previous frame, warped and masked (equations 3 and 4), and its inputs to the refiner."""
    render, jitter = current.inputs.render, current.inputs.view.jitter
    dtype = render.base_color.dtype
    color, previous_depth, base, normal, usable = nearest.values.split_with_sizes([3, 1, 3, 3, 1], dim=1)
    base, normal = base.to(dtype), normal.to(dtype)
    toned = ops.tone(ops.sanitize(color, 0.0) * current.inputs.exposure)
    kept = nearest.on_screen * usable
    if masked:
        now = (current.toned.to(dtype), render.base_color, render.depth)
        kept = kept * (1.0 - surfaces.occluded(now, (toned.to(dtype), base, previous_depth)))
    closest = surfaces.closest_around(render.depth)
    depth = surfaces.relative_depth(render.depth, closest)
    previous_depth = surfaces.relative_depth(previous_depth, closest) * kept
    place = nearest.offset + jitter[:, :, None, None]  # of the sample, from the pixel's centre
    refiner_inputs = [_scaled(motion), render.base_color, render.normal, depth, render.roughness]
    refiner_inputs += [torch.cat([base, normal], dim=1) * kept, 1.0 - kept, previous_depth]
    features = torch.cat([toned * kept, previous_depth, place * kept], dim=1)
    return features.to(dtype), torch.cat([part.to(dtype) for part in refiner_inputs], dim=1)


def _scaled(motion: Tensor) -> Tensor:
    return (motion / MOTION_UNIT).clamp(-4.0, 4.0)
