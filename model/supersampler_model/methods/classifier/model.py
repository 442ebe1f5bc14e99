"""`classifier`: temporal supersampling guided by a classifier (Guo et al. 2022), the default method.

A small network at half display size classifies each pixel: why its history may be invalid (disocclusion; a
change of lighting) and why one sample may alias (an edge; fine detail). A compositor then blends up to six
colours: the history warped by the dilated motion, the same clipped to the colours of this frame (Salvi 2016),
the history warped by the pixel's own motion, the nearest samples of this frame, this frame smoothly
upsampled, and this frame under a learned kernel. With a network output of zeros the result is the running
mean of all samples.

Light ten stops over white (GLARING) that was not there before is shown, but not accumulated: the running mean
restarts after it, until such light is there for a third frame in a row. The same holds for light over white
where it rises over all that the history has seen in one pixel of 64 (`unexplained_light`). The mean of all
pixels restarts after a frame whose measured exposure is an outlier (`is_flash`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar, cast

import torch
from torch import Tensor, nn

from supersampler.methods.classifier.spec import (
    CLASSES,
    CLASSIFIER,
    CONTRAST,
    FLASH_FRACTION,
    RISE,
    WHITE,
    ClassifierConfig,
)
from supersampler.methods.spec import HALF
from supersampler_model.methods.base import Fused
from supersampler_model.methods.classifier.buffers import (
    CurrentFrame,
    Finished,
    Gathered,
    History,
    WarpedHistory,
)
from supersampler_model.methods.classifier.network import ClassifierNetwork, classes_of, cut_to, pack
from supersampler_model.methods.classifier.network_inputs import neighbourhood_inputs, pixel_inputs
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.at_rest import RestFrame, RestHistory, compare, converge, kept, kept_frame
from supersampler_model.ops.color import (
    CONFIRMED,
    GLARE,
    MAX_HALF,
    TONED,
    TONES,
    bounded,
    exposure_for,
    from_ycocg,
    glaring,
    is_flash,
    limited,
    luminance,
    sanitize,
    valid,
    without_glare,
    ycocg,
)
from supersampler_model.ops.compositing import composite, reactive_at
from supersampler_model.ops.missing import filled
from supersampler_model.ops.motion import (
    Reprojection,
    dilate_motion_2x2,
    disocclusion,
    occluding_depth,
    read,
    read_cubic,
    relative_depth_change,
    reproject,
    to_display,
    usable_depth,
    usable_motion,
)
from supersampler_model.ops.rectification import Box, step_to_box
from supersampler_model.ops.sampling import (
    MIN_WEIGHT,
    Grid,
    View,
    catmull_rom,
    gaussian,
    grid_of,
    local_moments,
    neighbourhood_samples,
    pick,
    pick_first,
    pick_first_vector,
    pick_vector,
    upsample,
    weighed,
)
from supersampler_model.ops.size import Size, display_size_of, half_of, render_size_of
from supersampler_model.ops.windows import channels_of, maximum_3x3, minimum_3x3

HEIGHT = 64.0
"""Of the Gaussian of a sample along an axis: at a height of 1, far weights are too small for half floats."""
MOST_FACTOR: Mapping[torch.dtype, float] = {torch.float32: 16.0, torch.float16: 8.0}
"""Maximum of the logarithm of a factor: sums of nine such factors are half floats."""
SHARPEST = 2.0  # maximum factor of the detail that is added
DIM = 1e30  # the unit off screen: every colour becomes black


class Classifier(LearnedMethod):
    """Classify, then compose."""

    spec: ClassVar = CLASSIFIER
    config: ClassifierConfig
    in_half: ClassVar = True

    def make_network(self) -> nn.Module:
        """Return the untrained network."""
        c = self.config
        return ClassifierNetwork(
            c.network, packed=4 * c.planes, half_inputs=c.half_inputs, blend_parameters=c.blend_parameters
        )

    def fused(self) -> Fused | None:
        """Classifier and compositor, on packed pixels; tensor names are those of released graphs."""
        c = self.config
        inputs = {"packed": (1, 4 * c.planes, *HALF), "half_inputs": (1, c.half_inputs, *HALF)}
        return Fused(
            self.net,
            inputs,
            {"logits": (1, CLASSES, *HALF), "blend_parameters": (1, 4 * c.blend_parameters, *HALF)},
        )

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        *others: Tensor,  # `adds_samples`, where there is a mean, and `Classifier.history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the auxiliary outputs."""
        history = others[-len(self.history) :]
        history_tensors, now, before = self.group_history(history, color, jitter, display_size)
        gathered = self.gather(color, depth, motion, exposure, history_tensors, now, before)
        gathered = gathered._replace(reactive=reactive_at(reactive, valid(color), gathered.grid))
        if "static_mean" not in self.history:
            return self.step_outputs(gathered, *self.infer(gathered), jitter)
        frame = RestFrame(color, motion, jitter, gathered.exposure, reactive, others[0])
        return self.converged_outputs(
            gathered, frame, history_tensors, before.jitter, RestHistory(*history[-4:])
        )

    def converged_outputs(
        self,
        gathered: Gathered,
        frame: RestFrame,
        history: History,
        before: Tensor,
        rest: RestHistory,
        others: Sequence[tuple[Tensor, Tensor]] = (),
    ) -> tuple[Tensor, ...]:
        """Return the outputs of a step that converges where nothing changes.

        Args:
            gathered: from `gather`.
            frame: this frame.
            history: the method's own.
            before: (1, 2) jitter of the previous frame.
            rest: that of `ops.at_rest`.
            others: more planes of the method's own history, as they were and as this frame leaves them.
        """
        display = render_size_of(rest.mean)
        still = compare(frame, rest, render_size_of(history.depth), display)
        resting = still.resting(gathered.display)
        image, color, state, classes, surfaces, jitter, followed, weight = self.step_outputs(
            gathered, *self.infer(gathered), frame.jitter, resting
        )
        own = (
            kept(resting, history.color, color),
            kept(resting, history.state, state),
            kept(resting[:, :, ::2, ::2], history.classes, classes),
            kept_frame(still, history.depth, surfaces),
            kept_frame(still, before, jitter),
            kept_frame(still, history.exposure, followed),
            *(kept(resting, old, new) for old, new in others),
        )
        grid = grid_of(display, render_size_of(frame.color), frame.jitter)
        rested = converge(self.displayed(image, display, gathered), frame, still, grid)
        return (rested.image, *own, *rested.history, weight, rested.frozen)

    def displayed(self, image: Tensor, display: Size, gathered: Gathered) -> Tensor:  # noqa: ARG002  # of classifier-large
        """Return the image at the size of the display."""
        return image

    @staticmethod
    def group_history(
        history: Sequence[Tensor], color: Tensor, jitter: Tensor, display_size: Tensor
    ) -> tuple[History, View, View]:
        """Return the history tensors by name, and the views of this frame and of the previous one."""
        history_color, state, classes, depth, history_jitter, exposure = history[:6]
        display = display_size_of(display_size)
        now = View(display, render_size_of(color), jitter)
        before = View(display, render_size_of(depth), history_jitter)
        return History(history_color, state, classes, depth, exposure), now, before

    def step_outputs(
        self, gathered: Gathered, logits: Tensor, blend: Tensor, jitter: Tensor, resting: Tensor | None = None
    ) -> tuple[Tensor, ...]:
        """Return the method's own image and next history, and the weight of the history.

        Args:
            gathered: from `gather`.
            logits: from `infer`.
            blend: likewise.
            jitter: (1, 2) of this frame.
            resting: (1, 1, H, W) 1 where the history will be kept; None: nowhere.
        """
        done = self.finish(gathered, logits, blend, resting)
        history = (done.image, done.state, done.classes, gathered.surfaces, jitter * 1.0, gathered.followed)
        return (done.image, *history, done.weight)

    def gather(
        self,
        color: Tensor,
        depth: Tensor,
        motion: Tensor,
        exposure: Tensor,
        history: History,
        now: View,
        before: View,
    ) -> Gathered:
        """Resample this frame and the history at the display pixels."""
        usable, color = valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, history.exposure)
        flash = is_flash(followed, exposure, history.exposure)
        exposure = followed.abs()
        depth, motion = usable_depth(depth), usable_motion(motion)
        surfaces = torch.cat([depth, occluding_depth(depth, motion)], dim=1)
        grid = now.grid(render_size_of(color), aligned=True)
        closest, dilated = dilate_motion_2x2(depth, motion)
        closest = pick_first(closest, grid)
        vectors, own_vectors = (to_display(vector, now.display, now.extent) for vector in (dilated, motion))
        front = reproject(pick_first_vector(vectors, grid), now.display, grid)
        own = reproject(pick_vector(own_vectors, grid), now.display, grid)
        exposed = filled(color, usable, exposure) * exposure
        planes = [maximum_3x3(glaring(exposed, usable)), edge_of(depth), maximum_3x3(usable)]
        at_pixel = channels_of(pick(torch.cat(planes, dim=1).to(self.dtype), grid))
        current = self.gather_current(self.toned(exposed), usable, at_pixel, now, grid)
        warped = self.gather_history(history, front, own, closest, before, exposure)
        return Gathered(
            current, warped, front, closest, surfaces, exposure, followed, flash, now.display, grid
        )

    def toned(self, color: Tensor, unit: Tensor | float = 1.0) -> Tensor:
        """Linear RGB to the space in which colours are blended; `unit`: see `tone`."""
        return TONES[self.config.tone_space].tone(color, unit)

    def gather_current(
        self, toned: Tensor, usable: Tensor, at_pixel: Sequence[Tensor], view: View, grid: Grid
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame.

        Args:
            toned: (1, 3, h, w), filled where samples are missing; shown where no other is near.
            usable: (1, 1, h, w) 0 where a sample is missing, else 1.
            at_pixel: its glare, edge, sampled.
            view: of the frame.
            grid: of the display.
        """
        c, most = self.config, TONED[self.dtype]
        ratio = view.display.width / view.extent.width, view.display.height / view.extent.height
        fill, toned = pick(toned, grid), toned * usable
        samples = torch.cat([toned, usable], dim=1).to(self.dtype)
        near = upsample(samples, grid, lambda d: HEIGHT * gaussian(c.sample_sigma)(d), ratio)
        sharp = upsample(samples, grid, catmull_rom)
        first, second, found = local_moments(ycocg(toned), usable, grid, c.moment_sigma)
        deviation = (second - first * first).clamp(min=0.0).sqrt()  # a small difference: in float32
        mean = first.to(self.dtype)
        smooth = torch.where(found > MIN_WEIGHT, from_ycocg(mean), fill.to(self.dtype))
        sharp, whole = sharp.split_with_sizes([3, 1], dim=1)
        near, weight = near.split_with_sizes([3, 1], dim=1)
        # with missing samples the negative weights dominate
        frame = torch.where(whole > 0.9, sharp / whole.clamp(min=0.9), smooth)
        glare, edge, sampled = at_pixel
        return CurrentFrame(
            frame=frame.clamp(0.0, most),
            sample=(near / weight.clamp(min=1e-6 * HEIGHT**2)).clamp(0.0, most),
            confidence=(weight / HEIGHT**2).clamp(max=1.0),
            mean=mean,
            deviation=deviation.to(self.dtype),
            window=neighbourhood_samples(samples, grid, c.kernel_sigma),
            edge=edge,
            glare=glare,
            sampled=sampled,
        )

    def gather_history(
        self,
        history: History,
        front: Reprojection,
        own: Reprojection,
        depth: Tensor,
        before: View,
        exposure: Tensor,
    ) -> WarpedHistory:
        """Warp the history."""
        c, on = self.config, front.on_screen  # zeros off screen, as before a first frame
        position = front.position
        place = before.to_render(position)
        opened, depths = history.depth[:, 1:2], history.depth[:, :1]
        occluded = disocclusion(depth, opened, place, c.depth_margin, c.depth_ramp)
        depth_before = on * read(depths, (place + 0.5).floor(), mode="nearest")
        difference = relative_depth_change(depth_before, depth)  # equation 10
        samples, least, most = channels_of(on * front.read(history.state))
        most, glare = without_glare(most)
        given = sanitize(history.color, 0.0)
        unit = 1.0 / exposure
        unit_on_screen = torch.where(on > 0.0, unit, DIM)
        linear = self.toned(front.read(given), unit_on_screen)
        cubic = read_cubic(given, position, c.history_sharpness).clamp(0.0, MAX_HALF)
        color = self.toned(cubic, unit_on_screen)
        return WarpedHistory(
            color=color,
            rounded=color.to(self.dtype),
            detail=(color - linear).to(self.dtype),
            own=self.toned(own.read(given), unit),
            samples=samples,
            range=torch.cat([least, most], dim=1),
            glare=glare,
            difference=(difference.clamp(-1.0, 1.0) * (depth >= 0.0)).to(self.dtype),
            surface=on * (1.0 - 2.0 * occluded).clamp(min=0.0),
            classes=(on[:, :, ::2, ::2] * read(history.classes, 0.5 * position[:, ::2, ::2])).to(self.dtype),
        )

    def infer(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """Return logits (1, 6, H / 2, W / 2) and blend parameters (1, m, H, W)."""
        infer = cast("Callable[..., tuple[Tensor, Tensor]]", self.net.on_pixels)
        return infer(*self.inputs_of_pixels(gathered))

    def network_inputs(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """Return the network inputs: packed pixels, and channels at half display size."""
        pixels, half_inputs = self.inputs_of_pixels(gathered)
        return pack(torch.cat(pixels, dim=1)), half_inputs

    def inputs_of_pixels(self, gathered: Gathered) -> tuple[list[Tensor], Tensor]:
        """Return the network inputs: channels at display size, and channels at half display size."""
        c = self.config
        pixels = pixel_inputs(gathered, c.count_code)
        around = neighbourhood_inputs(pixels, gathered.display)
        classes = gathered.warped.classes[:, : CLASSES * c.recurrent]
        half_inputs = torch.cat([classes, *(around[name] for name in c.neighbourhood_inputs)], dim=1)
        return [pixels[name].to(self.dtype) for name in c.inputs], half_inputs

    def history_colors(self, gathered: Gathered, sharpness: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return the history colours and their initial weights, those of a running mean.

        Colours are float32; what is added to the warped one may be half floats.
        """
        current, warped, most = gathered.current, gathered.warped, TONED[torch.float32]
        sharpened = (warped.color + sharpness.clamp(0.0, SHARPEST) * warped.detail).clamp(0.0, most)
        known = (warped.samples > 0.0).float()  # without history the weight is 0 whatever the network infers
        found = [(sharpened, known * (warped.samples * warped.surface + 1e-3))]
        other = known * (0.1 * warped.samples + 1e-3)
        if self.config.rectified:
            box = Box(current.mean, self.config.gamma * current.deviation)
            step = from_ycocg(step_to_box(ycocg(sharpened.to(self.dtype)), box))
            found.append(((sharpened + step).clamp(0.0, most), other))
        if self.config.own_motion:
            found.append((warped.own, other))
        return found

    def finish(
        self, gathered: Gathered, logits: Tensor, blend: Tensor, resting: Tensor | None = None
    ) -> Finished:
        """Blend, update count, luma range and classes, and return to linear RGB.

        Args:
            gathered: from `gather`.
            logits: (1, 6, H / 2, W / 2).
            blend: (1, m, H, W) blend parameters.
            resting: see `step_outputs`.
        """
        current, warped = gathered.current, gathered.warped
        parts = (self.config.candidates, *self.config.filters)
        blend = blend.clamp(-16.0, MOST_FACTOR[blend.dtype])
        factors, sharpness, kernel = blend.split_with_sizes(parts, dim=1)
        history_colors = self.history_colors(gathered, sharpness)
        kernel = limited(weighed(current.window, kernel, current.frame))
        sampled = current.sampled.float()
        current_colors = [
            (current.sample, sampled * (current.confidence.float() + 1e-3)),
            (current.frame, 0.05 * sampled),
            (kernel, 0.05 * sampled),
        ]
        color, weight, odds = composite(
            history_colors, current_colors, factors, gathered.reactive, current.frame
        )
        image = bounded(TONES[self.config.tone_space].inverse(color) / gathered.exposure)

        classes = classes_of(logits.float(), warped.samples[:, :, ::2, ::2] > 0.0)
        count = torch.minimum(odds, warped.samples).clamp(max=self.config.samples) + current.confidence
        luma = luminance(current.sample)
        trust = (4.0 * odds / warped.samples.clamp(min=1e-6)).clamp(max=1.0) * (warped.samples > 0.0)
        rate = current.confidence * self.config.contraction
        low, high = channels_of(warped.range)
        low = torch.minimum(low, luma) + rate * (luma - low).clamp(min=0.0)
        high = torch.maximum(high, luma) - rate * (high - luma).clamp(min=0.0)
        low, high = luma + trust * (low - luma), luma + trust * (high - luma)
        glares = (current.glare > 0.0) & ((warped.samples > 0.0) | (warped.glare > 0.0))
        still_bright = (luma > WHITE) & (warped.glare > 0.0)
        unexplained = unexplained_light(luma, current.mean[:, :1], warped, gathered.display, resting)
        unconfirmed = glares | still_bright | unexplained
        unconfirmed = unconfirmed & (warped.glare < CONFIRMED - 1.0)
        count = torch.where(unconfirmed | gathered.flash, 0.0, count)
        glared = torch.where(unconfirmed, warped.glare + 1.0, (CONFIRMED * current.glare).float())
        state = torch.cat([count, low, high + GLARE * glared], dim=1)
        display = gathered.display
        image, state, weight = (cut_to(plane, display) for plane in (image, state, weight))
        return Finished(image, state, cut_to(classes, half_of(display)), weight)


def edge_of(depth: Tensor) -> Tensor:
    """(1, 1, h, w) relative range of depth over 3x3 samples, [0, 1]."""
    closest, farthest = maximum_3x3(depth), minimum_3x3(depth)
    return ((closest - farthest.clamp(min=0.0)) / closest.clamp(min=1e-12)).clamp(0.0, 1.0)


def unexplained_light(
    luma: Tensor, around: Tensor, warped: WarpedHistory, display: Size, resting: Tensor | None
) -> Tensor:
    """(1, 1, H, W) bool: where light rises over all samples of the history, in a frame that is a flash.

    Args:
        luma: (1, 1, H, W) of the samples near each pixel, toned.
        around: (1, 1, H, W) mean luma of a neighbourhood, toned.
        warped: the history.
        display: (width, height) of the image; planes may extend beyond it.
        resting: (1, 1, H, W) 1 where pixels do not count; None: all do.
    """
    known = warped.samples * warped.surface > 0.0
    rises = (luma > WHITE) & (luma > warped.range[:, 1:2] + RISE) & known
    bright = cut_to((rises & (luma > around + CONTRAST)).float(), display)
    counted = bright if resting is None else bright * (1.0 - resting)
    sparse = counted.sum(dim=(2, 3), keepdim=True)
    return rises & (sparse / (display.width * display.height) > FLASH_FRACTION)
