"""Training of `gbuffer`: an image loss weighted towards reflective surfaces (Wang et al. 2025, III.E)."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.methods.gbuffer import FrameInputs, Gathered, GBuffer, History
from supersampler_model.training.crops import CropFrame, Stream
from supersampler_model.training.datasets import gbuffer_set
from supersampler_model.training.losses import ImageWeights, display_values, dissimilarity
from supersampler_model.training.task import State, Stepped, Task, fast_convolutions

COS_45 = 0.5**0.5
METALLIC, SMOOTH = 0.95, 0.02  # minimum metallic or maximum roughness of mirrors


@dataclass(frozen=True)
class GBufferWeights(ImageWeights):
    """Weights of the loss terms; see `ClassifierWeights` for `rms`."""

    rms: float = 3.0
    reflective: float = 0.5  # extra weight of the image error on mirror-like surfaces
    structure: float = 0.1  # of the structural dissimilarity, 1 - SSIM
    reflective_structure: float = 0.75  # extra weight of the dissimilarity on mirror-like surfaces


class GBufferTask(Task):
    """Image loss only; states are in the order of `GBuffer.history`."""

    method: GBuffer
    losses = GBufferWeights()

    def data(self, dataset: Dataset) -> Dataset:
        """Return a `gbuffer_set`."""
        return gbuffer_set(dataset, self.method.config.ratio)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops of whole render pixels."""
        ratios = self.method.config.ratio, self.method.config.ratio
        return Stream(datasets, ratios=ratios, size=size, seed=seed, gbuffers="both", aligned=True)

    def first_state(self, crop: CropFrame) -> State:
        """Return zeros."""
        empty = self.method.first_history(crop.view.display, ops.size_of(crop.color))
        return [tensor.to(crop.color.device) for tensor in empty]

    def step(self, crops: list[CropFrame], states: list[State]) -> Stepped:
        """Step all crops; between frames, gradients flow through the image, but not through the count."""
        method = self.method
        gathered = [self.gather(crop, state) for crop, state in zip(crops, states, strict=True)]
        with fast_convolutions(crops[0].color.device, training=torch.is_grad_enabled()):
            (blend,) = method.net(*map(torch.cat, zip(*(g.inputs for g in gathered), strict=True)))
        blend = blend.float()
        images, after = [], []
        for i, (g, state) in enumerate(zip(gathered, states, strict=True)):
            done = method.finish(g, blend[i : i + 1], History(*state))
            images.append(done.image)
            after.append(list(done.history._replace(sample_count=done.history.sample_count.detach())))
        batch, reflective = torch.cat(images), torch.cat([reflective_of(g) for g in gathered])
        weights, exposure = self.losses, torch.cat([crop.exposure for crop in crops])
        reference = display_values(torch.cat([crop.reference for crop in crops]), exposure)
        map_ = dissimilarity(display_values(batch, exposure), reference)
        structure = weights.structure * _mean(map_, 1.0 + weights.reflective_structure * reflective)
        return Stepped(batch, after, 1.0 + weights.reflective * reflective, {"structure": structure})

    def gather(self, crop: CropFrame, state: State) -> Gathered:
        """Run the gather stage on one crop."""
        render, display = self.method.surfaces_of(crop.gbuffer, crop.depth)
        frame = FrameInputs(crop.color, crop.motion, crop.exposure, render, display, crop.view)
        return self.method.gather(frame, History(*state))


def reflective_of(gathered: Gathered) -> Tensor:
    """Return M_L (1, 1, H, W): 1 on metal, on mirrors and where the normal turned by 45 degrees, else 0."""
    surfaces = gathered.current.inputs.display
    ratio = surfaces.normal.shape[2] // gathered.frame.shape[2]
    before = F.interpolate(gathered.previous_normal, scale_factor=float(ratio), mode="nearest")
    known = (before.square().sum(dim=1, keepdim=True) > 0.5).float()
    turned = ((surfaces.normal * before).sum(dim=1, keepdim=True) < COS_45).float() * known
    no_sky = (surfaces.normal.square().sum(dim=1, keepdim=True) > 0.5).float()
    mirror = ((surfaces.metallic > METALLIC) | (surfaces.roughness < SMOOTH)).float()
    return torch.maximum(turned, mirror) * no_sky


def _mean(values: Tensor, weight: Tensor) -> Tensor:
    """Return the weighted mean over known values (equation 6)."""
    known = values.isfinite().float()
    values = torch.where(known > 0.0, values, torch.zeros_like(values))
    return (values * weight).sum() / (known * weight).sum().clamp(min=1.0)
