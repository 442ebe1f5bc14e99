"""`gbuffer-fast`: `classifier` where G-buffers of display size are known.

Each sample is divided by the reflectance of its own surface, which leaves light. Light is resampled at the
display pixels from the samples of similar surfaces, and multiplied by the reflectance of each pixel's own
surface: an image with the textures and edges of the G-buffers in the first frame, the guided colour. It takes
the place of this frame's upsampled colour, and a learned kernel on its 3x3 pixels that of the kernel on
samples: it smooths edges, which one sample a pixel leaves jagged. The history warped by the surface's own
motion is relit: divided by the reflectance of then, multiplied by that of now. The rest is `classifier`.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

import torch
from torch import Tensor

from supersampler.methods.gbuffer_fast.spec import GBUFFER_FAST, GBUFFERS_READ, GuidedConfig
from supersampler_model.methods.classifier.buffers import CurrentFrame, Gathered, History, WarpedHistory
from supersampler_model.methods.classifier.model import DIM, HEIGHT, Classifier, edge_of
from supersampler_model.methods.classifier.network_inputs import root
from supersampler_model.methods.classifier.transfer import transferred
from supersampler_model.methods.gbuffer.model import NEIGHBOUR_WEIGHTS
from supersampler_model.methods.gbuffer.surfaces import lit
from supersampler_model.methods.gbuffer_fast.surfaces import Surfaces, guide
from supersampler_model.methods.weights_file import Trained
from supersampler_model.ops.at_rest import RestFrame, RestHistory
from supersampler_model.ops.color import (
    MAX_HALF,
    TONED,
    exposure_for,
    glaring,
    is_flash,
    largest,
    limited,
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
    relative_depth_change,
    reproject,
    to_display,
    usable_motion,
)
from supersampler_model.ops.sampling import (
    WINDOW,
    Grid,
    View,
    Window,
    at_pixels,
    gaussian,
    local_moments,
    pick,
    pick_first_vector,
    upsample,
)
from supersampler_model.ops.size import Size, render_size_of
from supersampler_model.ops.windows import channels_of, maximum_3x3, padded_3x3


class FrameInputs(NamedTuple):
    """The inputs of one frame."""

    color: Tensor  # (1, 3, h, w) linear RGB
    depth: Tensor  # (1, 1, h, w) reversed
    motion: Tensor  # (1, 2, h, w) render pixels, previous minus current
    exposure: Tensor  # (1,) 0: measure
    render: Surfaces
    display: Surfaces
    view: View


class GuidedHistory(NamedTuple):
    """The history: that of `classifier`, and reflectance."""

    shared: History
    reflectance: Tensor  # (1, 3, H, W)
    view: View  # of the previous frame


class GuidedClassifier(Classifier):
    """`Classifier` on guided colours."""

    spec: ClassVar = GBUFFER_FAST
    config: GuidedConfig

    @classmethod
    def from_classifier(cls, trained: Trained) -> Self:
        """Return the method before its training, with the weights of `classifier` for what both have.

        Args:
            trained: weights of `classifier`.

        Raises:
            ArgumentError: they are of another method.
        """
        method = cls()
        method.load_state_dict(transferred(trained, method.config))
        method.learned = trained.facts
        return method.eval()

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        *others: Tensor,  # `adds_samples`, G-buffers in the order of `inputs`, the history
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the auxiliary outputs."""
        adds_samples, *buffers = others[: 1 + len(GBUFFERS_READ)]
        render, display = self.surfaces_of(dict(zip(GBUFFERS_READ, buffers, strict=True)), depth)
        history = others[1 + len(GBUFFERS_READ) :]
        shared, now, before = self.group_history(history, color, jitter, display_size)
        frame = FrameInputs(color, depth, motion, exposure, render, display, now)
        gathered = self.gather_guided(frame, GuidedHistory(shared, history[6], before))
        gathered = gathered._replace(reactive=reactive_at(reactive, valid(color), gathered.grid))
        samples = RestFrame(color, motion, jitter, gathered.exposure, reactive, adds_samples)
        reflectance = history[6], self.reflectance_of(display)
        rest = RestHistory(*history[-4:])
        return self.converged_outputs(gathered, samples, shared, before.jitter, rest, [reflectance])

    @staticmethod
    def surfaces_of(gbuffers: Mapping[str, Tensor], depth: Tensor) -> tuple[Surfaces, Surfaces]:
        """Return the surfaces at render and at display size, from G-buffers by input name."""
        render = Surfaces(gbuffers["gbuffer_base_color"], gbuffers["gbuffer_normal"], depth)
        return render, Surfaces(*(gbuffers[f"gbuffer_display_{name}"] for name in Surfaces._fields))

    def reflectance_of(self, display: Surfaces) -> Tensor:
        """Return the reflectance that the history keeps, (1, 3, H, W)."""
        return display.usable(self.dtype).reflectance(self.config.min_reflectance).float()

    def gather_guided(self, frame: FrameInputs, history: GuidedHistory) -> Gathered:
        """Resample this frame and the history at the display pixels."""
        usable, color = valid(frame.color), sanitize(frame.color, 0.0)
        before = history.shared.exposure
        followed = exposure_for(color, usable, frame.exposure, before)
        flash = is_flash(followed, frame.exposure, before)
        exposure, view, c = followed.abs(), frame.view, self.config
        motion = usable_motion(frame.motion)
        render, whole = (surfaces.usable(self.dtype) for surfaces in (frame.render, frame.display))
        grid = view.grid(render_size_of(color), aligned=True)
        display = Surfaces(*(at_pixels(image, grid) for image in whole))
        exposed = filled(color, usable, exposure) * exposure
        light = limited(tone(exposed / render.reflectance(c.min_reflectance)).to(self.dtype))
        guided = guide(light, usable, motion, render, display, grid, c)
        reflectance = display.reflectance(c.min_reflectance)
        edge = at_pixels(edge_of(whole.depth).to(self.dtype), grid)
        current = self.gather_now(exposed, usable, lit(guided.light, reflectance), edge, view, grid)
        _, dilated = dilate_motion_2x2(render.depth, motion)
        front = reproject(
            pick_first_vector(to_display(dilated, view.display, view.extent), grid), view.display, grid
        )
        own = reproject(to_display(guided.motion, view.display, view.extent), view.display, grid)
        warped = self.warp_history(history, front, own, display.depth, reflectance, exposure)
        surfaces = torch.cat([render.depth, occluding_depth(render.depth, motion)], dim=1)
        inputs = {
            "relit_to_frame": largest((root(warped.own.to(self.dtype)) - root(current.frame)).abs()),
            "agreement": guided.agreement.to(self.dtype),
        }
        return Gathered(
            current, warped, front, display.depth, surfaces, exposure, followed, flash, view.display, grid,
            inputs,
        )  # fmt: skip

    def gather_now(
        self, exposed: Tensor, usable: Tensor, guided: Tensor, edge: Tensor, view: View, grid: Grid
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame, beside what surfaces tell.

        Args:
            exposed: (1, 3, h, w) exposed colour.
            usable: (1, 1, h, w) 1 where it is valid, else 0.
            guided: (1, 3, H, W) light of the display's surfaces times their reflectance, toned.
            edge: (1, 1, H, W) relative range of depth around.
            view: of this frame.
            grid: of the display.
        """
        c, toned = self.config, self.toned(exposed) * usable
        ratio = view.display.width / view.extent.width, view.display.height / view.extent.height
        samples = torch.cat([toned, usable], dim=1).to(self.dtype)
        near = upsample(samples, grid, lambda d: HEIGHT * gaussian(c.sample_sigma)(d), ratio)
        near, weight = near.split_with_sizes([3, 1], dim=1)
        first, second, _ = local_moments(ycocg(toned), usable, grid, c.moment_sigma)
        deviation = (second - first * first).clamp(min=0.0).sqrt()  # a small difference: in float32
        planes = [maximum_3x3(glaring(exposed, usable)), maximum_3x3(usable)]
        glare, sampled = channels_of(pick(torch.cat(planes, dim=1).to(self.dtype), grid))
        return CurrentFrame(
            frame=guided,
            sample=(near / weight.clamp(min=1e-6 * HEIGHT**2)).clamp(0.0, TONED[self.dtype]),
            confidence=(weight / HEIGHT**2).clamp(max=1.0),
            mean=first.to(self.dtype),
            deviation=deviation.to(self.dtype),
            window=neighbours(guided, view.display),
            edge=edge,
            glare=glare,
            sampled=sampled,
        )

    def warp_history(
        self,
        history: GuidedHistory,
        front: Reprojection,
        own: Reprojection,
        depth: Tensor,
        reflectance: Tensor,
        exposure: Tensor,
    ) -> WarpedHistory:
        """Warp the history: by the dilated motion, and relit by that of each pixel's surface.

        Args:
            history: after the previous frame.
            front: by the dilated motion.
            own: by the motion of each pixel's own surface.
            depth: (1, 1, H, W) of that surface.
            reflectance: (1, 3, H, W) of it.
            exposure: (1,) of this frame.
        """
        c, shared, on = self.config, history.shared, front.on_screen
        place = history.view.to_render(own.position)
        depths, opened = channels_of(shared.depth)
        occluded = disocclusion(depth, opened, place, c.depth_margin, c.depth_ramp)
        depth_before = own.on_screen * read(depths, (place + 0.5).floor(), mode="nearest")
        difference = relative_depth_change(depth_before, depth)  # equation 10
        samples, least, most = channels_of(on * front.read(shared.state))
        most, glare = without_glare(most)
        given, unit = sanitize(shared.color, 0.0), 1.0 / exposure
        unit_on_screen = torch.where(on > 0.0, unit, DIM)
        linear = self.toned(front.read(given), unit_on_screen)
        cubic = read_cubic(given, front.position, c.history_sharpness).clamp(0.0, MAX_HALF)
        color = self.toned(cubic, unit_on_screen)
        before = own.read(history.reflectance).clamp(min=0.5 * c.min_reflectance)
        relit = (own.read(given) * (reflectance.float() / before)).clamp(0.0, MAX_HALF)
        return WarpedHistory(
            color=color,
            rounded=color.to(self.dtype),
            detail=(color - linear).to(self.dtype),
            own=self.toned(relit, torch.where(own.on_screen > 0.0, unit, DIM)),
            samples=samples,
            range=torch.cat([least, most], dim=1),
            glare=glare,
            difference=(difference.clamp(-1.0, 1.0) * (depth >= 0.0)).to(self.dtype),
            surface=own.on_screen * (1.0 - 2.0 * occluded).clamp(min=0.0),
            classes=(on[:, :, ::2, ::2] * read(shared.classes, 0.5 * front.position[:, ::2, ::2])).to(
                self.dtype
            ),
        )


def neighbours(image: Tensor, display: Size) -> Window:
    """Return the 3x3 pixels around each pixel, (1, 3, H, W), with their initial weights."""
    tall, h, w = padded_3x3(image, display), image.shape[2], image.shape[3]
    pixels = [tall[:, :, dy : dy + h, dx : dx + w] for dy in range(3) for dx in range(3)]
    weights = image.new_tensor(NEIGHBOUR_WEIGHTS).reshape(1, WINDOW, 1, 1)
    return Window(torch.stack(pixels, dim=2), weights)
