"""`classifier`: temporal supersampling guided by a classifier (Guo et al. 2022), the default method.

A small network at half display size says of each pixel why its past may be of no use (it was hidden; its
light has changed) and why one sample does not tell its colour (an edge; fine detail). A compositor then
weighs what there is: the past warped by the motion of what is in front, the same cut to this frame's colours
(Salvi 2016), the past warped by the pixel's own motion, this frame's nearest sample and this frame smoothly
upsampled. With a network that says nothing the result is the running mean of all samples.

Light ten stops over white, where there was none near, is shown, but leaves no past: the running mean begins
anew after it, until there is such light for a third frame in a row.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import torch
from torch import Tensor, nn

from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER, ClassifierConfig, NetworkConfig
from supersampler.methods.spec import HALF
from supersampler_model.methods.base import (
    Fused,
    display_size_of,
    render_size_of,
)
from supersampler_model.methods.classifier.buffers import Finished, Gathered, History, Present, Remembered
from supersampler_model.methods.classifier.network import (
    ClassifierNetwork,
    pack,
    shares,
    unpack,
)
from supersampler_model.methods.classifier.network_inputs import around_of, inputs_of
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.color import (
    CONFIRMED,
    GLARE,
    TONES,
    bounded,
    exposure_for,
    from_ycocg,
    glaring,
    luminance,
    sanitize,
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
    usable_depth,
    usable_motion,
)
from supersampler_model.ops.rectification import clip_to_center, variance_box
from supersampler_model.ops.sampling import (
    Grid,
    View,
    catmull_rom,
    extreme,
    gaussian,
    local_moments,
    neighbours,
    normalised,
    pick,
    pick_first,
    sum_of,
    upsample,
    weighed,
    window_of,
)

TONED = 1.0 - 1e-4  # most of a toned colour
SHARPEST = 2.0  # most that is added of what the cubic has sharpened
SIDE = 0.01  # weight of a neighbour in the cross on the past, at first


class Classifier(LearnedMethod):
    """Classify, then compose."""

    spec: ClassVar = CLASSIFIER

    def __init__(self, config: ClassifierConfig | None = None) -> None:
        super().__init__()
        self.config: ClassifierConfig = config or self.spec.config()
        self.net = self.make_network()

    def make_network(self) -> nn.Module:
        """Return the network, untrained."""
        c = self.config
        return ClassifierNetwork(c.network, packed=4 * c.planes, carried=c.carried, mixing=c.blend_parameters)

    def fused(self) -> Fused | None:
        """Classifier and compositor, on packed pixels."""
        c = self.config
        inputs = {"packed": (1, 4 * c.planes, *HALF), "carried": (1, c.carried, *HALF)}
        return Fused(
            self.net, inputs, {"logits": (1, CLASSES, *HALF), "mixing": (1, 4 * c.blend_parameters, *HALF)}
        )

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """See `LearnedMethod`."""
        settings = dict(config)
        network = dict(settings.pop("network"))
        network["levels"] = tuple(network["levels"])
        settings |= {name: tuple(settings[name]) for name in ("inputs", "around")}
        return cls(cls.spec.config(network=NetworkConfig(**network), **settings))

    def forward(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        history_color: Tensor,  # (1, 3, H, W)
        history_state: Tensor,  # (1, 3, H, W)
        history_classes: Tensor,  # (1, 6, H / 2, W / 2)
        history_depth: Tensor,  # (1, 2, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_exposure: Tensor,  # (1,)
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the history and the weight of the past."""
        display = display_size_of(display_size)
        now = View(display, render_size_of(color), jitter)
        before = View(display, render_size_of(history_depth), history_jitter)
        history = History(history_color, history_state, history_classes, history_depth, history_exposure)
        gathered = self.gather(color, depth, motion, exposure, history, now, before)
        logits, mixing = self.net(*self.seen(gathered))
        return self.left(gathered, logits, mixing, jitter)

    def left(self, gathered: Gathered, logits: Tensor, mixing: Tensor, jitter: Tensor) -> tuple[Tensor, ...]:
        """Return what `forward` does, of what the network has said."""
        done = self.finish(gathered, logits, mixing)
        left = (done.image, done.state, done.classes, gathered.surfaces, jitter * 1.0, gathered.followed)
        return (done.image, *left, done.weight)

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
        """Bring this frame and the past to display size."""
        usable, color = valid(color), sanitize(color, 0.0)
        followed = exposure_for(color, usable, exposure, history.exposure)
        exposure = followed.abs()
        depth = usable_depth(depth)
        surfaces = torch.cat([depth, morphological_opening(depth)], dim=1)
        motion, grid = usable_motion(motion), now.grid(render_size_of(color))
        closest = pick_first(torch.cat(dilate_motion_2x2(depth, motion), dim=1), grid)
        there = past_of(closest[:, 1:], now.display, now.extent)
        own = past_of(pick(motion, grid), now.display, now.extent)
        exposed = color * exposure
        glare = pick(extreme(glaring(exposed, usable), torch.maximum), grid)
        present = self.gather_present(self.toned(exposed) * usable, usable, depth, glare, now, grid)
        past = self.gather_past(history, there, own, closest[:, :1], before, exposure)
        return Gathered(present, past, there, closest[:, :1], surfaces, exposure, followed)

    def toned(self, color: Tensor) -> Tensor:
        """Exposed linear RGB to the space that it is weighed in."""
        return TONES[self.config.tone_space].tone(color)

    def gather_present(
        self, toned: Tensor, usable: Tensor, depth: Tensor, glare: Tensor, view: View, grid: Grid
    ) -> Present:
        """Upsample the usable samples of this frame."""
        c = self.config
        ratio = view.display.width / view.extent.width, view.display.height / view.extent.height
        samples = torch.cat([toned, usable], dim=1)
        near = upsample(samples, grid, gaussian(c.sample_sigma), ratio)
        sharp = upsample(samples, grid, catmull_rom)
        first, second = local_moments(ycocg(toned), usable, grid, c.moment_sigma)
        smooth = from_ycocg(first)
        closest, farthest = extreme(depth, torch.maximum), extreme(depth, torch.minimum)
        edge = (closest - farthest.clamp(min=0.0)) / closest.clamp(min=1e-12)
        whole = (sharp[:, 3:4] > 0.9).float()  # some of its weights are negative: of no use where many miss
        return Present(
            frame=(smooth + whole * (normalised(sharp) - smooth)).clamp(0.0, TONED),
            sample=normalised(near).clamp(0.0, TONED),
            confidence=near[:, 3:4].clamp(max=1.0),
            first=first,
            second=second,
            window=window_of(samples, grid, c.kernel_sigma),
            edge=pick(edge.clamp(0.0, 1.0), grid),
            glare=glare,
        )

    def gather_past(
        self, history: History, past: Past, own: Past, depth: Tensor, before: View, exposure: Tensor
    ) -> Remembered:
        """Warp the history."""
        c, on = self.config, past.on_screen  # off screen is as before a first frame: 0
        x, y = before.to_render(past.x, past.y)
        hidden = covered(depth, history.depth[:, 1:2], x, y, c.depth_margin, c.depth_ramp)
        there = on * read(history.depth[:, :1], (x + 0.5).floor(), (y + 0.5).floor(), mode="nearest")
        difference = (there - depth) / torch.maximum(there, depth).clamp(min=1e-12)  # equation 10
        state = on * read(history.state, past.x, past.y)
        most, glare = without_glare(state[:, 2:3])
        linear = self.toned(sanitize(read(history.color, past.x, past.y), 0.0) * exposure) * on
        cubic = sanitize(read_cubic(history.color, past.x, past.y, c.history_sharpness), 0.0)
        color = self.toned(cubic * exposure) * on
        return Remembered(
            color=color,
            detail=color - linear,
            own=self.toned(sanitize(read(history.color, own.x, own.y), 0.0) * exposure),
            samples=state[:, :1],
            range=torch.cat([state[:, 1:2], most], dim=1),
            glare=glare,
            difference=difference.clamp(-1.0, 1.0) * (depth >= 0.0),
            surface=on * (1.0 - 2.0 * hidden).clamp(min=0.0),
            classes=on[:, :, ::2, ::2]
            * read(history.classes, 0.5 * past.x[:, :, ::2, ::2], 0.5 * past.y[:, :, ::2, ::2]),
        )

    def seen(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """What the network sees: of pixels, packed, and at half size."""
        c = self.config
        pixels = inputs_of(gathered.present, gathered.past, gathered.there, c.count_code)
        around = around_of(pixels)
        classes = gathered.past.classes[:, : CLASSES * c.recurrent]
        packed = pack(torch.cat([pixels[name] for name in c.inputs], dim=1))
        return packed, torch.cat([classes, *(around[name] for name in c.around)], dim=1)

    def pasts(self, gathered: Gathered, sharpness: Tensor, cross: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Colours of the past, and the weights of a running mean, which the network multiplies."""
        present, past = gathered.present, gathered.past
        moved = past.color
        if self.config.corrected:  # a mean: with negative weights the recursion could amplify what it meets
            sides = [SIDE * cross[:, i : i + 1].exp() for i in range(4)]
            beside = zip(sides, neighbours(past.color)[1::2], strict=True)
            moved = sum_of([moved, *(w * color for w, color in beside)]) / (1.0 + sum_of(sides))
        sharpened = (moved + sharpness.clamp(0.0, SHARPEST) * past.detail).clamp(0.0, TONED)
        known = (past.samples > 0.0).float()  # without a past its colour is no colour, whatever is said of it
        found = [(sharpened, known * (past.samples * past.surface + 1e-3))]
        other = known * (0.1 * past.samples + 1e-3)
        if self.config.rectified:
            box = variance_box(present.first, present.second, self.config.gamma)
            found.append((from_ycocg(clip_to_center(ycocg(sharpened), box)).clamp(0.0, TONED), other))
        if self.config.own_motion:
            found.append((past.own, other))
        return found

    def finish(self, gathered: Gathered, logits: Tensor, mixing: Tensor) -> Finished:
        """Compose, count, and go back to linear RGB."""
        present, past = gathered.present, gathered.past
        h, w = present.frame.shape[2], present.frame.shape[3]
        parts = (self.config.candidates, *self.config.filters)
        said, sharpness, cross, kernel = (
            unpack(mixing, h, w).clamp(-16.0, 16.0).split_with_sizes(parts, dim=1)
        )
        pasts = self.pasts(gathered, sharpness, cross)
        kernel = weighed(present.window, kernel, present.frame)
        there = (sum_of([sample[:, 3:] for sample in present.window]) > 0.0).float()
        sampled = there * (present.confidence + 1e-3)
        presents = [(present.sample, sampled), (present.frame, 0.05 * there), (kernel, 0.05 * there)]
        begun = [weight for _, weight in (*pasts, *presents)]
        weights = [b * said[:, i : i + 1].exp() for i, b in enumerate(begun)]
        kept, new = sum_of(weights[: len(pasts)]), sum_of(weights[len(pasts) :])
        total = (kept + new).clamp(min=1e-12)  # 0 where nothing is known: black
        color = sum_of([w / total * c for w, (c, _) in zip(weights, (*pasts, *presents), strict=True)])
        image = bounded(TONES[self.config.tone_space].inverse(color) / gathered.exposure)

        classes = torch.cat([shares(logits[:, :3]), shares(logits[:, 3:])], dim=1)
        odds = (
            kept / new.clamp(min=1e-12) * sum_of(begun[len(pasts) :])
        )  # samples that the past was taken for
        count = torch.minimum(odds, past.samples).clamp(max=self.config.samples) + present.confidence
        luma = luminance(present.sample)
        held = (4.0 * odds / past.samples.clamp(min=1e-6)).clamp(max=1.0) * (past.samples > 0.0)
        rate = present.confidence * self.config.contraction
        low, high = past.range[:, :1], past.range[:, 1:2]
        low = torch.minimum(low, luma) + rate * (luma - low).clamp(min=0.0)
        high = torch.maximum(high, luma) - rate * (high - luma).clamp(min=0.0)
        range_ = luma + held * (torch.cat([low, high], dim=1) - luma)
        unconfirmed = (present.glare > 0.0) & (past.glare < CONFIRMED - 1.0)
        unconfirmed = unconfirmed & ((past.samples > 0.0) | (past.glare > 0.0))
        count = torch.where(unconfirmed, torch.zeros_like(count), count)
        glared = torch.where(unconfirmed, past.glare + 1.0, CONFIRMED * present.glare)
        state = torch.cat([count, range_[:, :1], range_[:, 1:2] + GLARE * glared], dim=1)
        return Finished(image, state, classes, kept / total)
