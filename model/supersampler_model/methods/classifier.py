"""`classifier`: temporal supersampling guided by a classifier (Guo et al. 2022), the default method.

A small network at half display size classifies each pixel: why its history may be invalid (disocclusion, or a
change of lighting) and why one sample may alias (an edge, or fine detail). A compositor then blends up to six
colours: the history warped by the dilated motion, the same clipped to the colours of this frame (Salvi 2016),
the history warped by the pixel's own motion, the nearest samples of this frame, this frame smoothly
upsampled, and this frame under a learned kernel. If the network infers zeros, the result is the running mean
of all samples.

New light ten stops over white (GLARE_EXPOSED) is shown, but not accumulated: the running mean restarts after
it, until such light appears in a third consecutive frame. Light over white is treated in the same way where
more than one pixel in 64 rises above all samples of its history (`unexplained_light`). The mean of all pixels
restarts after a frame whose measured exposure is an outlier (`is_flash`).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self, TypeVar, cast

import torch
from torch import Tensor, nn

from supersampler.errors import ArgumentError
from supersampler.io.display import MAX_HALF
from supersampler.methods.classifier import spec as classifier
from supersampler.methods.classifier_large.spec import CLASSIFIER_LARGE
from supersampler.methods.constants import CONFIRMED, GLARE, MIN_CUBIC_WEIGHT, MIN_WEIGHT
from supersampler.methods.spec import HALF, LARGE_HALF
from supersampler_model import ops
from supersampler_model.methods.base import LearnedMethod, NetworkSubgraph, Trained, config_of
from supersampler_model.methods.classifier_inputs import (
    CurrentFrame,
    Gathered,
    History,
    WarpedHistory,
    neighbourhood_inputs,
    pixel_inputs,
)
from supersampler_model.methods.classifier_network import ClassifierNetwork, classes_of, pack
from supersampler_model.ops import at_rest

HEIGHT = 64.0
"""Height of a sample's Gaussian along an axis. With 1, far weights would be too small for half floats."""
MAX_FACTOR: Mapping[torch.dtype, float] = {torch.float32: classifier.MAX_LOG_FACTOR, torch.float16: 8.0}
"""Maximum of the logarithm of a factor: half floats can represent sums of nine such factors."""
DIM = 1e30  # `unit` of `tone` off screen: every colour becomes black


class Finished(NamedTuple):
    """Results of the finish stage."""

    image: Tensor  # (1, 3, H, W) linear RGB
    state: Tensor  # as in `Classifier.history`
    classes: Tensor
    weight: Tensor  # (1, 1, H, W) weight of the history in the image


Adapted = TypeVar("Adapted", bound="Classifier")


def adapted(method_class: type[Adapted], trained: Trained) -> Adapted:
    """Return a method, in evaluation mode, with the weights of `classifier` for the parts that both have.

    Raises:
        ArgumentError: the weights are of another method.
    """
    method = method_class()
    method.load_state_dict(transferred(trained, method.config))
    method.provenance = trained.facts
    return method.eval()


class Classifier(LearnedMethod):
    """Classify, then compose."""

    spec: ClassVar = classifier.CLASSIFIER
    config: classifier.ClassifierConfig
    runs_in_fp16: ClassVar = True
    network_class: ClassVar[type[ClassifierNetwork]] = ClassifierNetwork
    larger: ClassVar = False  # whether history and network have 1.4 times the display's width and height

    def make_network(self) -> nn.Module:
        """Return the untrained network."""
        c = self.config
        return self.network_class(
            c.network, packed=4 * c.planes, half_inputs=c.half_inputs, blend_parameters=c.blend_parameters
        )

    def subgraph(self) -> NetworkSubgraph | None:
        """Return classifier and compositor, on packed pixels, with the tensor names of released graphs."""
        c, half = self.config, LARGE_HALF if self.larger else HALF
        inputs = {"packed": (1, 4 * c.planes, *half), "half_inputs": (1, c.half_inputs, *half)}
        outputs = {
            "logits": (1, classifier.CLASSES, *half),
            "blend_parameters": (1, 4 * c.blend_parameters, *half),
        }
        return NetworkSubgraph(self.net, inputs, outputs)

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
        inner = display_size
        if self.larger:
            inner = (1.4 * display_size + 0.9).floor().long()  # integer division is not portable
        history = others[-len(self.history) :]
        grouped, now, before = self.group_history(history, color, jitter, inner)
        gathered = self.gather(color, depth, motion, exposure, grouped, now, before)
        gathered = gathered._replace(reactive=ops.reactive_at(reactive, ops.valid(color), gathered.grid))
        if "static_mean" not in self.history:
            return self.step_outputs(gathered, *self.infer(gathered), jitter)
        frame = at_rest.RestFrame(color, motion, jitter, gathered.exposure, reactive, others[0])
        outputs = self.converged_outputs(
            gathered, frame, grouped, before.jitter, at_rest.RestHistory(*history[-4:])
        )
        if not self.larger:
            return outputs
        *first, weight, frozen = outputs
        return (*first, ops.resize_nearest(weight, ops.display_size_of(display_size)), frozen)

    def converged_outputs(
        self,
        gathered: Gathered,
        frame: at_rest.RestFrame,
        history: History,
        before: Tensor,
        rest: at_rest.RestHistory,
        others: Sequence[tuple[Tensor, Tensor]] = (),
    ) -> tuple[Tensor, ...]:
        """Return the outputs of a step that converges where nothing changes.

        `before`, (1, 2), is the jitter of the previous frame, `rest` the history of `ops.at_rest`. `others`
        are further planes of the method's own history, before and after this frame.
        """
        display = ops.size_of(rest.mean)
        blocks = at_rest.compare(frame, rest, ops.size_of(history.depth), display)
        resting = blocks.resting(gathered.display)
        image, color, state, classes, surfaces, jitter, followed, weight = self.step_outputs(
            gathered, *self.infer(gathered), frame.jitter, resting
        )
        own = (
            at_rest.kept(resting, history.color, color),
            at_rest.kept(resting, history.state, state),
            at_rest.kept(resting[:, :, ::2, ::2], history.classes, classes),
            blocks.kept(history.depth, surfaces),
            blocks.kept(before, jitter),
            blocks.kept(history.exposure, followed),
            *(at_rest.kept(resting, old, new) for old, new in others),
        )
        grid = ops.grid_of(display, ops.size_of(frame.color), frame.jitter)
        shown = ops.downsample(image, display, gathered.exposure) if self.larger else image
        converged = at_rest.converge(shown, frame, blocks, grid)
        return (converged.image, *own, *converged.history, weight, converged.frozen)

    @staticmethod
    def group_history(
        history: Sequence[Tensor], color: Tensor, jitter: Tensor, display_size: Tensor
    ) -> tuple[History, ops.View, ops.View]:
        """Return the history tensors by name, and the views of this frame and of the previous one."""
        history_color, state, classes, depth, history_jitter, exposure = history[:6]
        display = ops.display_size_of(display_size)
        now = ops.View(display, ops.size_of(color), jitter)
        before = ops.View(display, ops.size_of(depth), history_jitter)
        return History(history_color, state, classes, depth, exposure), now, before

    def step_outputs(
        self, gathered: Gathered, logits: Tensor, blend: Tensor, jitter: Tensor, resting: Tensor | None = None
    ) -> tuple[Tensor, ...]:
        """Return the method's own image and next history, and the weight of the history.

        Args:
            gathered: result of `gather`.
            logits: logits from `infer`, as `blend`.
            blend: blend parameters.
            jitter: (1, 2) of this frame.
            resting: (1, 1, H, W) 1 where the history will not change; None: nowhere.
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
        now: ops.View,
        before: ops.View,
    ) -> Gathered:
        """Resample this frame and the history at the display pixels."""
        usable, color = ops.valid(color), ops.sanitize(color, 0.0)
        followed = ops.exposure_for(color, usable, exposure, history.exposure)
        flash = ops.is_flash(followed, exposure, history.exposure)
        exposure = followed.abs()
        depth, motion = ops.usable_depth(depth), ops.usable_motion(motion)
        surfaces = torch.cat([depth, ops.occluding_depth(depth, motion)], dim=1)
        grid = now.grid(ops.size_of(color), aligned=True)
        closest, dilated = ops.dilate_motion_2x2(depth, motion)
        closest = grid.pick_first(closest)
        vectors, own_vectors = (ops.to_display(m, now.display, now.extent) for m in (dilated, motion))
        by_dilated = ops.reproject(grid.pick_first_vectors(vectors), now.display, grid)
        by_own = ops.reproject(grid.pick_vectors(own_vectors), now.display, grid)
        exposed = ops.filled(color, usable, exposure) * exposure
        planes = [ops.maximum_3x3(ops.glaring(exposed, usable)), edge_of(depth), ops.maximum_3x3(usable)]
        at_pixel = ops.channels_of(grid.pick(torch.cat(planes, dim=1).to(self.dtype)))
        current = self.gather_current(self.toned(exposed), usable, at_pixel, now, grid)
        warped = self.gather_history(history, by_dilated, by_own, closest, before, exposure)
        return Gathered(
            current, warped, by_dilated, closest, surfaces, exposure, followed, flash, now.display, grid
        )

    def toned(self, color: Tensor, unit: Tensor | float = 1.0) -> Tensor:
        """Convert linear RGB to the space in which colours are blended; `unit`: see `tone`."""
        return ops.TONES[self.config.tone_space].tone(color, unit)

    def gather_current(
        self, toned: Tensor, usable: Tensor, at_pixel: Sequence[Tensor], view: ops.View, grid: ops.Grid
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame.

        Args:
            toned: (1, 3, h, w), filled where samples are missing; the result where no other sample is near.
            usable: (1, 1, h, w) 0 where a sample is missing, else 1.
            at_pixel: `glare`, `edge` and `sampled` of the result.
            view: view of the frame.
            grid: grid of the display.
        """
        luma = ops.upsample_along_edges(ops.ycocg(toned)[:, :1], usable, grid)
        peak, fill, toned = grid.pick(ops.peak(toned)), grid.pick(toned), toned * usable
        samples = torch.cat([toned, usable], dim=1).to(self.dtype)
        sample, confidence = self.near_samples(samples, view, grid)
        sharp = grid.upsample(samples, ops.catmull_rom)
        mean, deviation, found = self.local_statistics(toned, usable, grid)
        smooth = torch.where(found > MIN_WEIGHT, ops.from_ycocg(mean), fill.to(self.dtype))
        sharp, whole = sharp.split_with_sizes([3, 1], dim=1)
        # with missing samples the negative weights dominate
        frame = torch.where(whole > MIN_CUBIC_WEIGHT, sharp / whole.clamp(min=MIN_CUBIC_WEIGHT), smooth)
        glare, edge, sampled = at_pixel
        return CurrentFrame(
            frame=frame.clamp(0.0, ops.TONED[self.dtype]),
            sample=sample,
            confidence=confidence,
            mean=mean,
            deviation=deviation,
            window=ops.neighbourhood_samples(samples, grid, self.config.kernel_sigma),
            edge=edge,
            glare=glare,
            sampled=sampled,
            luma=luma,
            peak=peak,
        )

    def near_samples(self, samples: Tensor, view: ops.View, grid: ops.Grid) -> tuple[Tensor, Tensor]:
        """Return the mean of the samples near each pixel, and the sum of their weights in [0, 1]."""
        near = grid.upsample(
            samples, lambda d: HEIGHT * ops.gaussian(self.config.sample_sigma)(d), view.ratio
        )
        near, weight = near.split_with_sizes([3, 1], dim=1)
        mean = (near / weight.clamp(min=1e-6 * HEIGHT**2)).clamp(0.0, ops.TONED[self.dtype])
        return mean, (weight / HEIGHT**2).clamp(max=1.0)

    def local_statistics(
        self, toned: Tensor, usable: Tensor, grid: ops.Grid
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Return mean and deviation of the samples around, YCoCg, and the sum of their weights."""
        first, second, found = ops.local_moments(ops.ycocg(toned), usable, grid, self.config.moment_sigma)
        deviation = (second - first * first).clamp(min=0.0).sqrt()  # a small difference: in float32
        return first.to(self.dtype), deviation.to(self.dtype), found

    def gather_history(
        self,
        history: History,
        by_dilated: ops.Reprojection,
        by_own: ops.Reprojection,
        depth: Tensor,
        before: ops.View,
        exposure: Tensor,
        relit: Tensor | None = None,
    ) -> WarpedHistory:
        """Warp the history.

        Args:
            history: after the previous frame.
            by_dilated: reprojection by the dilated motion.
            by_own: reprojection by the pixel's own motion.
            depth: (1, 1, H, W) of the closest sample around, or of the pixel's own surface, with G-buffers.
            before: view of the previous frame.
            exposure: (1,) of this frame.
            relit: (1, 3, H, W) with G-buffers of display size: factor of the colour warped by the pixel's own
                motion. The history's depth is then warped by that motion, too.
        """
        c, on = self.config, by_dilated.on_screen  # zeros off screen, as before a first frame
        surface = by_dilated if relit is None else by_own
        place = before.to_render(surface.position)
        split = relit is not None  # either way, with the operators of the released graphs
        parts = ops.channels_of(history.depth) if split else [history.depth[:, :1], history.depth[:, 1:2]]
        depths, occluders = parts
        occluded = ops.occlusion(depth, occluders, place, c.depth_margin, c.depth_ramp)
        depth_before = surface.on_screen * ops.read(depths, (place + 0.5).floor(), mode="nearest")
        difference = ops.relative_depth_change(depth_before, depth)  # equation 10
        samples, low, high = ops.channels_of(on * by_dilated.read(history.state))
        high, glare = ops.without_glare(high)
        given = ops.sanitize(history.color, 0.0)
        unit = 1.0 / exposure
        unit_on_screen = torch.where(on > 0.0, unit, DIM)
        linear = self.toned(by_dilated.read(given), unit_on_screen)
        cubic = ops.read_cubic(given, by_dilated.position, c.history_sharpness).clamp(0.0, MAX_HALF)
        color, undilated = self.toned(cubic, unit_on_screen), by_own.read(given)
        if relit is not None:
            undilated = (undilated * relit).clamp(0.0, MAX_HALF)
            unit = torch.where(by_own.on_screen > 0.0, unit, DIM)
        classes = ops.read(history.classes, 0.5 * by_dilated.position[:, ::2, ::2])
        return WarpedHistory(
            color=color,
            rounded=color.to(self.dtype),
            detail=(color - linear).to(self.dtype),
            undilated=self.toned(undilated, unit),
            samples=samples,
            range=torch.cat([low, high], dim=1),
            glare=glare,
            difference=(difference.clamp(-1.0, 1.0) * (depth >= 0.0)).to(self.dtype),
            surface=surface.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0),
            classes=(on[:, :, ::2, ::2] * classes).to(self.dtype),
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
        classes = gathered.warped.classes[:, : classifier.CLASSES * c.recurrent]
        half_inputs = torch.cat([classes, *(around[name] for name in c.neighbourhood_inputs)], dim=1)
        return [pixels[name].to(self.dtype) for name in c.inputs], half_inputs

    def history_colors(self, gathered: Gathered, sharpness: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return the history colours, float32, and their initial weights: a running mean."""
        current, warped, brightest = gathered.current, gathered.warped, ops.TONED[torch.float32]
        sharpened = warped.color + sharpness.clamp(0.0, classifier.MAX_SHARPNESS) * warped.detail
        sharpened = sharpened.clamp(0.0, brightest)
        visible = warped.samples * warped.surface
        known = (visible > 0.0).float()  # without history the weight is 0 whatever the network infers
        colors = [(sharpened, known * (visible + classifier.MIN_PRIOR))]
        weight = known * (classifier.OTHER_PRIOR * warped.samples + classifier.MIN_PRIOR)
        if self.config.rectified:
            box = ops.Box(current.mean, self.config.gamma * current.deviation)
            step = ops.from_ycocg(ops.step_to_box(ops.ycocg(sharpened.to(self.dtype)), box))
            colors.append(((sharpened + step).clamp(0.0, brightest), weight))
        if self.config.own_motion:
            colors.append((warped.undilated, weight))
        return colors

    def finish(
        self, gathered: Gathered, logits: Tensor, blend: Tensor, resting: Tensor | None = None
    ) -> Finished:
        """Blend, convert to linear RGB, and update count, luma range and classes.

        `logits` are (1, 6, H / 2, W / 2), the blend parameters (1, m, H, W); `resting`: see `step_outputs`.
        """
        c, current, warped, display = self.config, gathered.current, gathered.warped, gathered.display
        blend = blend.clamp(-classifier.MAX_LOG_FACTOR, MAX_FACTOR[blend.dtype])
        factors, sharpness, kernel = blend.split_with_sizes((c.candidates, *c.filters), dim=1)
        history_colors = self.history_colors(gathered, sharpness)
        kernel = ops.limited(current.window.mean(kernel, current.frame))
        sampled = current.sampled.float()
        current_colors = [
            (current.sample, sampled * (current.confidence.float() + classifier.MIN_PRIOR)),
            (current.frame, classifier.FRAME_PRIOR * sampled),
            (kernel, classifier.FRAME_PRIOR * sampled),
        ]
        color, weight, odds = ops.composite(
            history_colors, current_colors, factors, gathered.reactive, current.frame
        )
        odds = torch.where(sampled > 0.0, odds, weight * warped.samples)  # without samples, all that is known
        if current.luma is not None and current.peak is not None:
            alone = along_edges(color, current.luma, current.peak)
            color = torch.where(warped.samples * warped.surface > 0.0, color, alone)
        image = ops.bounded(ops.TONES[c.tone_space].inverse(color) / gathered.exposure)

        classes = classes_of(logits.float(), warped.samples[:, :, ::2, ::2] > 0.0)
        count = torch.minimum(odds, warped.samples).clamp(max=c.samples) + current.confidence
        luma = ops.luminance(current.sample)
        trust = (classifier.HALF_COUNT * odds / warped.samples.clamp(min=1e-6)).clamp(max=1.0) * (
            warped.samples > 0.0
        )
        rate = current.confidence * c.contraction
        low, high = ops.channels_of(warped.range)
        low = torch.where(sampled > 0.0, torch.minimum(low, luma), low) + rate * (luma - low).clamp(min=0.0)
        high = torch.maximum(high, luma) - rate * (high - luma).clamp(min=0.0)
        low, high = luma + trust * (low - luma), luma + trust * (high - luma)
        glares = (current.glare > 0.0) & ((warped.samples > 0.0) | (warped.glare > 0.0))
        still_bright = (luma > classifier.WHITE) & (warped.glare > 0.0)
        unexplained = unexplained_light(luma, current.mean[:, :1], warped, display, resting)
        unconfirmed = (glares | still_bright | unexplained) & (warped.glare < CONFIRMED - 1.0)
        count = torch.where(unconfirmed | gathered.flash, 0.0, count)
        glared = torch.where(unconfirmed, warped.glare + 1.0, (CONFIRMED * current.glare).float())
        state = torch.cat([count, low, high + GLARE * glared], dim=1)
        image, state, weight = (ops.cut_to(plane, display) for plane in (image, state, weight))
        return Finished(image, state, ops.cut_to(classes, ops.half_of(display)), weight)


class SmallClassifier(Classifier):
    """`classifier-small`: half the width and fewer blended colours, for CPUs."""

    spec: ClassVar = classifier.CLASSIFIER_SMALL


class LargeClassifier(Classifier):
    """`classifier-large`: a history and network images larger than the display, downsampled for it.

    Each frame resamples the history, which blurs it and lets fine detail alias. A history with 1.4 times the
    display's width and height loses less detail. Unreal Engine's Temporal Super Resolution does the same with
    history screen percentages over 100 ("TSR", SIGGRAPH 2022).
    """

    spec: ClassVar = CLASSIFIER_LARGE
    larger: ClassVar = True

    @classmethod
    def from_classifier(cls, trained: Trained) -> Self:
        """Return the method before its training; see `adapted`."""
        return adapted(cls, trained)


def edge_of(depth: Tensor) -> Tensor:
    """Return the relative range of depth over 3x3 samples, (1, 1, h, w) in [0, 1]."""
    closest, farthest = ops.maximum_3x3(depth), ops.minimum_3x3(depth)
    return ((closest - farthest.clamp(min=0.0)) / closest.clamp(min=1e-12)).clamp(0.0, 1.0)


def along_edges(color: Tensor, luma: Tensor, peak: Tensor) -> Tensor:
    """Average the luma of an image of one frame with luma upsampled along edges.

    The network's kernel of 3x3 samples leaves stairs on edges; elsewhere, the history removes them.

    Args:
        color: (1, 3, H, W) toned RGB.
        luma: (1, 1, H, W), Y of YCoCg.
        peak: (1, 1, H, W) of the samples around, see `ops.peak`.
    """
    color = color + 0.5 * (luma - ops.ycocg(color)[:, :1])
    return (color * ops.dimming(color, peak)).clamp(0.0, ops.TONED[torch.float32])


def unexplained_light(
    luma: Tensor, around: Tensor, warped: WarpedHistory, display: ops.Size, resting: Tensor | None
) -> Tensor:
    """Return whether light rises above all samples of the history, (1, 1, H, W), in a frame that is a flash.

    Args:
        luma: (1, 1, H, W) of the samples near each pixel, toned.
        around: (1, 1, H, W) mean luma of a neighbourhood, toned.
        warped: the history.
        display: (width, height) of the image; planes may extend beyond it.
        resting: (1, 1, H, W) 1 where pixels are not counted; None: all are.
    """
    known = warped.samples * warped.surface > 0.0
    rises = (luma > classifier.WHITE) & (luma > warped.range[:, 1:2] + classifier.RISE) & known
    bright = ops.cut_to((rises & (luma > around + classifier.CONTRAST)).float(), display)
    counted = bright if resting is None else bright * (1.0 - resting)
    sparse = counted.sum(dim=(2, 3), keepdim=True)
    return rises & (sparse / (display.width * display.height) > classifier.FLASH_FRACTION)


def transferred(trained: Trained, config: classifier.ClassifierConfig) -> Mapping[str, Tensor]:
    """Return the weights of `classifier` for a config of equal widths with other inputs or blended colours.

    Inputs and blended colours that `classifier` lacks get weights of 0; those that only `classifier` has are
    left out.

    Raises:
        ArgumentError: the weights are of another method.
    """
    if trained.method != Classifier.name:
        raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {Classifier.name}")
    theirs: Any = config_of(classifier.ClassifierConfig, trained.config)
    tensors = dict(trained.tensors)

    def move(name: str, old: Sequence[str], new: Sequence[str], axis: int) -> None:
        """Move the groups of four channels of an axis; the channels after them stay."""
        packed, weight = 4 * len(old), tensors[name]
        groups, rest = weight.split_with_sizes([packed, weight.shape[axis] - packed], dim=axis)
        known = dict(zip(old, groups.split_with_sizes([4] * len(old), dim=axis), strict=True))
        none = torch.zeros_like(groups.narrow(axis, 0, 4))
        tensors[name] = torch.cat([*(known.get(part, none) for part in new), rest], dim=axis)

    for name in ("net.encoder.blocks.0.0.0.weight", "net.hidden.0.weight"):
        move(name, theirs.inputs, config.inputs, axis=1)
    for name in ("net.blend.weight", "net.blend.bias"):
        move(name, _blended(theirs), _blended(config), axis=0)
    return tensors


def _blended(config: classifier.ClassifierConfig) -> tuple[str, ...]:
    """Return the names of the blend parameters, in their order."""
    colors = ["history", *["rectified"] * config.rectified, *["own"] * config.own_motion]
    names = [*colors, "sample", "frame", "kernel"]
    return (*names, *(f"{part}{i}" for part, count in enumerate(config.filters) for i in range(count)))
