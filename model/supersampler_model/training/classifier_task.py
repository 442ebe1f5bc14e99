"""Training of the classifiers: crops of equal shapes are gathered as a batch, and all are inferred as one."""

from collections.abc import Sequence

import torch
from torch import Tensor

from supersampler_model.data.dataset import Dataset
from supersampler_model.data.labels import Ghost
from supersampler_model.methods.classifier.buffers import Gathered, History
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import cut_to, unpack
from supersampler_model.ops.size import half_of, render_size_of
from supersampler_model.training.batching import in_batches
from supersampler_model.training.class_loss import ClassifierWeights, class_loss
from supersampler_model.training.crops import Sample, Stream
from supersampler_model.training.shots import UNKNOWN
from supersampler_model.training.task import State, Stepped, Task


class ClassifierTask(Task[Sample]):
    """Image and classification losses; states are in the order of `Classifier.history`, without a mean."""

    def __init__(self, method: Classifier, losses: ClassifierWeights | None = None) -> None:
        self.method: Classifier = method
        self.losses: ClassifierWeights = losses or ClassifierWeights()

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops at any position and ratio."""
        return Stream(datasets, ratios=self.method.ratios, size=size, seed=seed)

    def first_state(self, sample: Sample) -> State:
        """Zeros, with the jitter of the crop's view."""
        empty = self.method.first_history(sample.view.display, render_size_of(sample.color))
        color, state, classes, depth, _, exposure = (t.to(sample.color.device) for t in empty[:6])
        return [color, state, classes, depth, sample.view.jitter, exposure]

    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """Step all crops; from frame to frame gradients flow only through the history colour."""
        method = self.method
        gathered, inputs = self.gather_all(samples, states)
        packed, half_inputs = map(torch.cat, zip(*inputs, strict=True))
        with torch.autocast(packed.device.type, torch.bfloat16, enabled=method.training):
            logits, blend = method.net(packed, half_inputs)
        return self.stepped(samples, gathered, logits.float(), blend.float(), self.losses.ghost)

    def stepped(
        self,
        samples: list[Sample],
        gathered: list[Gathered],
        logits: Tensor,
        blend: Tensor,
        ghost_weight: Tensor | float,
    ) -> Stepped:
        """Finish all crops from the network's outputs.

        Args:
            samples: the crops.
            gathered: results of the gather stage.
            logits: (n, 6, H / 2, W / 2).
            blend: (n, 4 m, H / 2, W / 2) packed blend parameters.
            ghost_weight: (n, 1, 1, 1), or one for all: extra weight of the error with invalid history.
        """
        method, images, after = self.method, [], []
        # split at once: the gradient of each slice would be as large as the batch
        parts = (t.split_with_sizes([1] * len(samples)) for t in (logits, blend))
        finished = in_batches(
            lambda g, of_classes, of_blend: method.finish(g, of_classes, unpack(of_blend)),
            list(zip(gathered, *parts, strict=True)),
        )
        for g, sample, done in zip(gathered, samples, finished, strict=True):
            images.append(done.image)
            state, classes = done.state.detach(), done.classes.detach()
            after.append([done.image, state, classes, g.surfaces, sample.view.jitter, g.followed])
        ghost, alias = _ghost(samples, gathered), torch.cat([s.alias for s in samples])
        logits = cut_to(logits, half_of(gathered[0].display))
        invalid = ((ghost == Ghost.VISIBILITY) | (ghost == Ghost.SHADING)).float()[:, None]
        return Stepped(
            images=torch.cat(images),
            states=after,
            weight=1.0 + ghost_weight * invalid,
            terms={"classes": class_loss(logits, ghost, alias, self.losses)},
        )

    def gather_all(
        self, samples: Sequence[Sample], states: Sequence[State]
    ) -> tuple[list[Gathered], list[tuple[Tensor, Tensor]]]:
        """Run the gather stage on all crops; also return the inputs of the network."""

        def gather(sample: Sample, state: State) -> tuple[Gathered, tuple[Tensor, Tensor]]:
            gathered = self.gather(sample, state)
            return gathered, self.method.network_inputs(gathered)

        inputs = [sample.without_truth() for sample in samples]
        results = in_batches(gather, list(zip(inputs, states, strict=True)))
        return [gathered for gathered, _ in results], [of_network for _, of_network in results]

    def gather(self, sample: Sample, state: State) -> Gathered:
        """Run the gather stage on one crop."""
        color, counted, classes, depth, jitter, exposure = state
        history = History(color, counted, classes, depth, exposure)
        before = sample.view._replace(jitter=jitter)  # the region is the same in all frames of a crop
        return self.method.gather(
            sample.color, sample.depth, sample.motion, sample.exposure, history, sample.view, before
        )


def _ghost(samples: list[Sample], gathered: list[Gathered]) -> Tensor:
    """(n, H, W) ghosting classes; pixels reprojected outside of the crop are disoccluded."""
    ghost = torch.cat([s.ghost for s in samples])
    off_screen = torch.cat([1.0 - cut_to(g.reprojection.on_screen, g.display) for g in gathered])[:, 0] > 0.0
    return torch.where(off_screen & (ghost < UNKNOWN), Ghost.VISIBILITY, ghost)
