"""Training of `gbuffer-fast`: as `classifier`, on crops of any ratio with G-buffers of both sizes."""

from collections.abc import Sequence

from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.classifier.buffers import Gathered, History
from supersampler_model.methods.gbuffer_fast.model import FrameInputs, GuidedClassifier, GuidedHistory
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.crops import Sample, Stream
from supersampler_model.training.gbuffer_crops import guided_stream, unshaded_set
from supersampler_model.training.task import State, Stepped


class GuidedTask(ClassifierTask):
    """States are in the order of `GuidedClassifier.history`, without a mean."""

    method: GuidedClassifier

    def data(self, dataset: Dataset) -> Dataset:
        """See `unshaded_set`.

        Raises:
            ArgumentError: also where the set has no G-buffers of display size.
        """
        if not dataset.description.gbuffers:
            want = "a set made by `supersampler render --gbuffers --also 1.5,2,3,4`"
            raise ArgumentError("data", got=f"{dataset.folder}, without G-buffers of display size", want=want)
        return unshaded_set(dataset, self.method.ratios)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        """Stream crops at any position and ratio."""
        return guided_stream(datasets, ratios=self.method.ratios, size=size, seed=seed)

    def first_state(self, sample: Sample) -> State:
        """Zeros, with the jitter of the crop's view."""
        state = super().first_state(sample)
        return [*state, state[0].new_zeros(state[0].shape)]

    def gather(self, sample: Sample, state: State) -> Gathered:
        """Run the gather stage on one crop."""
        color, counted, classes, depth, jitter, exposure, reflectance = state
        render, display = self.method.surfaces_of(sample.gbuffer, sample.depth)
        history = GuidedHistory(
            History(color, counted, classes, depth, exposure),
            reflectance,
            sample.view._replace(jitter=jitter),  # the region is the same in all frames of a crop
        )
        frame = FrameInputs(
            sample.color, sample.depth, sample.motion, sample.exposure, render, display, sample.view
        )
        return self.method.gather_guided(frame, history)

    def stepped(
        self,
        samples: list[Sample],
        gathered: list[Gathered],
        logits: Tensor,
        blend: Tensor,
        ghost_weight: Tensor | float,
    ) -> Stepped:
        """See `ClassifierTask`; reflectance is a part of the states."""
        done = super().stepped(samples, gathered, logits, blend, ghost_weight)
        displays = [self.method.surfaces_of(s.gbuffer, s.depth)[1] for s in samples]
        kept = [self.method.reflectance_of(display) for display in displays]
        states = [[*state, reflectance] for state, reflectance in zip(done.states, kept, strict=True)]
        return done._replace(states=states)
