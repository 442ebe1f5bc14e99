"""How `guided-flow` is trained: on hidden frames, on what is drawn and on what the network makes of light.

Wu et al. 2023 (ExtraSS), equations 7 to 9: error and census of the network's own light, which is of half
size, and census of features. Beside it the picture's error, in which the blend counts, too.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.data.labels import Ghost
from supersampler_model.method import Method, Size, render_size_of
from supersampler_model.methods.guided import surface_of
from supersampler_model.methods.guided_flow import Gathered, GuidedFlow, halved, past_of
from supersampler_model.methods.guided_warp import GuidedWarp
from supersampler_model.sampling import sum_of
from supersampler_model.train.flow_windows import flow_stream
from supersampler_model.train.gbuffer_windows import gbuffer_set
from supersampler_model.train.losses import PictureWeights, census, charbonnier
from supersampler_model.train.task import State, Stepped, Task
from supersampler_model.train.walk import HidingWalk, Walk
from supersampler_model.train.windows import Sample, Stream

RATIO = 2  # at which sets are drawn again, with G-buffers of render size
STEPS = 255.0  # that a screen shows of toned light


@dataclass(frozen=True)
class FlowWeights(PictureWeights):
    """Weights of the terms; see `PictureWeights`.

    Attributes:
        shading: of errors where light has changed, beside that everywhere.
        light: of the error of the network's own light, and of its census.
        features: of their census (lambda of equation 9).
    """

    shading: float = 2.0
    light: float = 1.0
    features: float = 0.001


class FlowTask(Task):
    """Hidden frames alone; states are in the order of `GuidedFlow.history`."""

    def __init__(self, method: GuidedFlow, losses: FlowWeights | None = None) -> None:
        self.method: GuidedFlow = method
        self.losses: FlowWeights = losses or FlowWeights()

    @property
    def config(self) -> dict[str, Any]:
        """Of the method."""
        return asdict(self.method.config)

    @property
    def ratios(self) -> tuple[float, float]:
        """Of frames that were drawn with what the method reads."""
        return float(RATIO), float(RATIO)

    @property
    def bar(self) -> Method:
        """What it draws untrained."""
        return GuidedWarp()

    def data(self, dataset: Dataset) -> Dataset:
        """See `gbuffer_set`."""
        return gbuffer_set(dataset, RATIO)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Crops of render size.

        Raises:
            ArgumentError: see `flow_stream`; or the network's coarsest level has one pixel of a crop, which
                batch normalisation can tell nothing of.
        """
        least = 2 ** (len(self.method.config.network.levels) + 1)
        if size <= least:
            raise ArgumentError("size", got=size, want=f"more than {least}")
        return flow_stream(datasets, ratio=RATIO, size=size, seed=seed)

    def walk(self, method: Method, display: Size) -> Walk:
        """Every second frame is hidden; pictures are of those alone."""
        return HidingWalk(method, display)

    def first_state(self, sample: Sample) -> State:
        """All zeros."""
        empty = self.method.first_history(sample.view.display, render_size_of(sample.color))
        return [tensor.to(sample.color.device) for tensor in empty]

    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """Draw what is hidden, all of it together; shaded frames stay as they are."""
        images, after = [sample.color for sample in samples], list(states)
        hidden = [i for i, sample in enumerate(samples) if sample.hidden]
        gathered = [self.gather(samples[i], states[i]) for i in hidden]
        for i, sample in enumerate(samples):
            if not sample.hidden:
                past = None if sample.reset else states[i]
                after[i] = self.method.after_shaded(_inputs(sample), past)
        if not hidden:  # gradients of nothing, as an update may have no other frame
            nothing = 0.0 * sum_of([p.sum() for p in self.method.parameters()])
            return Stepped(torch.cat(images), after, terms={"light": nothing, "features": nothing})
        terms, drawn = self._drawn(gathered, [samples[i] for i in hidden])
        for i, g, image in zip(hidden, gathered, drawn, strict=True):
            images[i] = image
            after[i] = self.method.left(g, samples[i].view.jitter, past_of(*states[i]))
        return Stepped(
            images=torch.cat(images),
            states=after,
            weight=1.0 + self.losses.shading * torch.cat([shading_of(s) for s in samples]),
            terms=terms,
        )

    @torch.no_grad()
    def gather(self, sample: Sample, state: State) -> Gathered:
        """What one crop's hidden frame and its past tell before the network speaks."""
        there = sample.gbuffer
        now = surface_of(there["gbuffer_base_color"], there["gbuffer_normal"], sample.depth)
        roughness, jitter = there["gbuffer_roughness"], sample.view.jitter
        return self.method.gather(now, roughness, sample.motion, jitter, past_of(*state))

    def _drawn(
        self, gathered: list[Gathered], samples: list[Sample]
    ) -> tuple[dict[str, Tensor], list[Tensor]]:
        """Terms of the loss beside the picture's, and the pictures."""
        method, weights = self.method, self.losses
        later, earlier = (torch.cat(parts) for parts in zip(*(g.pictures for g in gathered), strict=True))
        truth = torch.cat([method.true_light(s.reference, g) for s, g in zip(samples, gathered, strict=True)])
        with torch.autocast(later.device.type, torch.bfloat16, enabled=torch.is_grad_enabled()):
            said, handed = method.net.refine(later, earlier)
            with torch.no_grad():
                wanted = method.net.features(torch.cat([truth, later[:, 3:]], dim=1))
        done = [method.finish(g, said[i : i + 1]) for i, g in enumerate(gathered)]
        light = torch.cat([d.light for d in done])
        more = 1.0 + weights.shading * torch.cat([halved(shading_of(s)) for s in samples])
        off = (more * charbonnier(light - truth)).mean()
        apart = census(STEPS * light.mean(dim=1, keepdim=True), STEPS * truth.mean(dim=1, keepdim=True), 7)
        pairs = zip(handed, wanted, strict=False)  # nothing is handed to the coarsest
        features = sum_of([census(a.float(), b.float(), 3).mean() for a, b in pairs])
        terms = {"light": weights.light * (off + apart.mean()), "features": weights.features * features}
        return terms, [d.image for d in done]


def shading_of(sample: Sample) -> Tensor:
    """(1, 1, h, w) 1 where light has changed on its surface since the frame before."""
    return (sample.ghost == Ghost.SHADING).float()[:, None]


def _inputs(sample: Sample) -> dict[str, Tensor]:
    frame = {"color": sample.color, "depth": sample.depth, "motion": sample.motion}
    return {**frame, "jitter": sample.view.jitter, **sample.gbuffer}
