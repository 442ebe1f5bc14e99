"""`gbuffer-fast`: `classifier` where G-buffers of display size are known.

Each sample is divided by the reflectance of its own surface, which leaves light. Light is resampled at the
display pixels from the samples of similar surfaces, and multiplied by the reflectance of each pixel's own
surface. The result, the guided colour, has the textures and edges of the G-buffers in the first frame. It
replaces the upsampled colour of this frame. The learned kernel averages its 3x3 pixels instead of the
samples, and smooths edges, which one sample per pixel leaves jagged. The history warped by the surface's own
motion is relit: divided by the previous reflectance, multiplied by the current one. The rest is `classifier`.
"""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

import torch
from torch import Tensor

from supersampler.methods.constants import MIN_NORMAL
from supersampler.methods.gbuffer.spec import NEIGHBOUR_WEIGHTS, STEP_COST
from supersampler.methods.gbuffer_fast import spec as gbuffer_fast
from supersampler_model import ops
from supersampler_model.methods.base import Trained
from supersampler_model.methods.classifier import Classifier, adapted, edge_of
from supersampler_model.methods.classifier_inputs import CurrentFrame, Gathered, History, root
from supersampler_model.methods.gbuffer_surfaces import depth_difference, lit, samples_3x3, squared_norm
from supersampler_model.ops import at_rest


class DisplaySurfaces(NamedTuple):
    """G-buffers, at render or display size; colours and normals in the working type."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    depth: Tensor  # (1, 1, h, w) reversed, float32

    def usable(self, dtype: torch.dtype) -> "DisplaySurfaces":
        """Sanitize: values out of range and NaN become 0, depth UNKNOWN_DEPTH."""
        base, normal = (image.to(dtype) for image in (self.base_color, self.normal))
        base = torch.where((base >= 0.0) & (base <= 1.0), base, 0.0)
        normal = torch.where((normal >= -1.0) & (normal <= 1.0), normal, 0.0)
        return DisplaySurfaces(base, normal, ops.usable_depth(self.depth))

    def reflectance(self, minimum: float) -> Tensor:
        """Return (1, 3, h, w): base colour, raised to `minimum` at black; 1 at the sky.

        Colour over reflectance is light, which varies less than textures do (FuseSR, Zhong et al. 2023).
        """
        sky = squared_norm(self.normal) < MIN_NORMAL
        return torch.where(sky, 1.0, minimum + (1.0 - minimum) * self.base_color)

    def features(self, config: gbuffer_fast.GuidedConfig) -> Tensor:
        """Return features (1, 6, h, w): their squared distance is the dissimilarity of base and normal."""
        normal = config.normal_falloff**0.5 * self.normal
        return torch.cat([normal, config.base_color_falloff**0.5 * self.base_color], dim=1)


class GuidedFrame(NamedTuple):
    """The inputs of one frame; depth is part of the surfaces."""

    color: Tensor  # (1, 3, h, w) linear RGB
    motion: Tensor  # (1, 2, h, w) render pixels, previous minus current
    exposure: Tensor  # (1,) 0: measure
    render: DisplaySurfaces
    display: DisplaySurfaces
    view: ops.View


class GuidedLight(NamedTuple):
    """This frame's light at display pixels, and the motion of their surfaces."""

    light: Tensor  # (1, 3, H, W) toned
    agreement: Tensor  # (1, 1, H, W) sum of the samples' weights, about 1 where a similar surface was sampled
    motion: Tensor  # (1, 2, H, W) render pixels


class GuidedClassifier(Classifier):
    """`Classifier` on guided colours."""

    spec: ClassVar = gbuffer_fast.GBUFFER_FAST
    config: gbuffer_fast.GuidedConfig

    @classmethod
    def from_classifier(cls, trained: Trained) -> Self:
        """Return the method before its training; see `adapted`."""
        return adapted(cls, trained)

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
        adds_samples, *buffers = others[: 1 + len(gbuffer_fast.GBUFFERS_READ)]
        render, display = self.surfaces_of(dict(zip(gbuffer_fast.GBUFFERS_READ, buffers, strict=True)), depth)
        history = others[1 + len(gbuffer_fast.GBUFFERS_READ) :]
        shared, now, before = self.group_history(history, color, jitter, display_size)
        frame = GuidedFrame(color, motion, exposure, render, display, now)
        gathered = self.gather_guided(frame, shared, history[6], before)
        gathered = gathered._replace(reactive=ops.reactive_at(reactive, ops.valid(color), gathered.grid))
        samples = at_rest.RestFrame(color, motion, jitter, gathered.exposure, reactive, adds_samples)
        reflectance = history[6], self.reflectance_of(display)
        rest = at_rest.RestHistory(*history[-4:])
        return self.converged_outputs(gathered, samples, shared, before.jitter, rest, [reflectance])

    @staticmethod
    def surfaces_of(gbuffers: Mapping[str, Tensor], depth: Tensor) -> tuple[DisplaySurfaces, DisplaySurfaces]:
        """Return the surfaces at render and at display size, from G-buffers by input name."""
        render = DisplaySurfaces(gbuffers["gbuffer_base_color"], gbuffers["gbuffer_normal"], depth)
        of_display = (gbuffers[f"gbuffer_display_{name}"] for name in DisplaySurfaces._fields)
        return render, DisplaySurfaces(*of_display)

    def reflectance_of(self, display: DisplaySurfaces) -> Tensor:
        """Return the reflectance that the history keeps, (1, 3, H, W)."""
        return display.usable(self.dtype).reflectance(self.config.min_reflectance).float()

    def gather_guided(
        self, frame: GuidedFrame, history: History, reflectance_before: Tensor, before: ops.View
    ) -> Gathered:
        """Resample this frame and the history at the display pixels.

        `reflectance_before`, (1, 3, H, W), and the view `before` belong to the previous frame.
        """
        usable, color = ops.valid(frame.color), ops.sanitize(frame.color, 0.0)
        followed = ops.exposure_for(color, usable, frame.exposure, history.exposure)
        flash = ops.is_flash(followed, frame.exposure, history.exposure)
        exposure, view, c = followed.abs(), frame.view, self.config
        motion = ops.usable_motion(frame.motion)
        render, whole = (surfaces.usable(self.dtype) for surfaces in (frame.render, frame.display))
        grid = view.grid(ops.size_of(color), aligned=True)
        display = DisplaySurfaces(*(grid.at_pixels(image) for image in whole))
        exposed = ops.filled(color, usable, exposure) * exposure
        light = ops.limited(ops.tone(exposed / render.reflectance(c.min_reflectance)).to(self.dtype))
        guided = guide(light, usable, motion, render, display, grid, c)
        reflectance = display.reflectance(c.min_reflectance)
        edge = grid.at_pixels(edge_of(whole.depth).to(self.dtype))
        current = self.gather_now(exposed, usable, lit(guided.light, reflectance), edge, view, grid)
        _, dilated = ops.dilate_motion_2x2(render.depth, motion)
        vectors = grid.pick_first_vectors(ops.to_display(dilated, view.display, view.extent))
        by_dilated = ops.reproject(vectors, view.display, grid)
        by_own = ops.reproject(ops.to_display(guided.motion, view.display, view.extent), view.display, grid)
        relit = reflectance.float() / by_own.read(reflectance_before).clamp(min=0.5 * c.min_reflectance)
        warped = self.gather_history(history, by_dilated, by_own, display.depth, before, exposure, relit)
        surfaces = torch.cat([render.depth, ops.occluding_depth(render.depth, motion)], dim=1)
        relit_to_frame = root(warped.undilated.to(self.dtype)) - root(current.frame)
        inputs = {
            "relit_to_frame": ops.largest(relit_to_frame.abs()),
            "agreement": guided.agreement.to(self.dtype),
        }
        return Gathered(
            current, warped, by_dilated, display.depth, surfaces, exposure, followed, flash, view.display,
            grid, inputs,
        )  # fmt: skip

    def gather_now(
        self, exposed: Tensor, usable: Tensor, guided: Tensor, edge: Tensor, view: ops.View, grid: ops.Grid
    ) -> CurrentFrame:
        """Upsample the usable samples of this frame, and add the guided colour.

        Args:
            exposed: (1, 3, h, w) exposed colour.
            usable: (1, 1, h, w) 1 where the colour is valid, else 0.
            guided: (1, 3, H, W) light of the display's surfaces times their reflectance, toned.
            edge: (1, 1, H, W) relative range of depth around.
            view: view of this frame.
            grid: grid of the display.
        """
        toned = self.toned(exposed) * usable
        samples = torch.cat([toned, usable], dim=1).to(self.dtype)
        sample, confidence = self.near_samples(samples, view, grid)
        mean, deviation, _ = self.local_statistics(toned, usable, grid)
        planes = [ops.maximum_3x3(ops.glaring(exposed, usable)), ops.maximum_3x3(usable)]
        glare, sampled = ops.channels_of(grid.pick(torch.cat(planes, dim=1).to(self.dtype)))
        window = neighbours(guided, view.display)
        return CurrentFrame(guided, sample, confidence, mean, deviation, window, edge, glare, sampled)


def neighbours(image: Tensor, display: ops.Size) -> ops.Window:
    """Return the 3x3 pixels around each pixel, (1, 3, H, W), with their initial weights."""
    weights = image.new_tensor(NEIGHBOUR_WEIGHTS).reshape(1, ops.WINDOW, 1, 1)
    return ops.Window(torch.stack(ops.neighbours_3x3(image, display), dim=2), weights)


def guide(
    light: Tensor,
    usable: Tensor,
    motion: Tensor,
    render: DisplaySurfaces,
    display: DisplaySurfaces,
    grid: ops.Grid,
    config: gbuffer_fast.GuidedConfig,
) -> GuidedLight:
    """Resample light from the 3x3 samples around each display pixel, by distance and agreement of surfaces.

    The motion comes from the sample whose depth is most similar.

    Args:
        light: (1, 3, h, w) colour over reflectance, toned, in the working type; filled where `usable` is 0.
        usable: (1, 1, h, w) 1 where the colour is valid, else 0.
        motion: (1, 2, h, w) render pixels.
        render: surfaces of the samples.
        display: surfaces of the pixels of the grid.
        grid: grid of the display.
        config: config of the method.
    """
    near = ops.gaussian(config.guide_sigma)
    own, target = render.features(config), display.features(config)
    lowest, chosen = torch.full_like(display.depth, torch.inf), None
    colors, weights, similar = [], [], []
    for down, across, (color, known, depth, features, moved) in samples_3x3(
        [light, usable, render.depth, own, motion], grid
    ):
        distance = near(grid.y.nearest + down - grid.y.position)[:, None] * near(
            grid.x.nearest + across - grid.x.position
        )
        difference = depth_difference(depth, display.depth)
        of_depth = (difference * difference * (0.5 / config.depth_sigma**2)).clamp(
            max=gbuffer_fast.MAX_DEPTH_COST
        )
        similarity = (-(of_depth + squared_norm(features - target).float())).exp()
        distance = (distance + gbuffer_fast.MIN_SIMILARITY) * known
        colors.append(color)
        weights.append(distance * (similarity + gbuffer_fast.MIN_SIMILARITY))
        similar.append(distance * similarity)
        cost = difference + STEP_COST * (down * down + across * across)
        chosen = moved if chosen is None else torch.where(cost < lowest, moved, chosen)
        lowest = torch.minimum(cost, lowest)
    assert chosen is not None  # noqa: S101 - nine samples
    found = ops.sum_of(weights)
    total = found.clamp(min=1e-9)
    mean = ops.sum_of([c * (w / total).to(c.dtype) for c, w in zip(colors, weights, strict=True)])
    mean = torch.where(found > 0.0, mean, grid.pick(light))
    return GuidedLight(mean, ops.sum_of(similar).clamp(max=1.0), chosen)
