"""Training of `classifier-large`: as `classifier`, at 1.4 times the crops."""

import torch

from supersampler.methods.sizes import large_size
from supersampler_model.ops.downsampling import downsample
from supersampler_model.ops.sampling import of_size
from supersampler_model.ops.size import Size
from supersampler_model.training.classifier_task import ClassifierTask
from supersampler_model.training.crops import Sample
from supersampler_model.training.task import State, Stepped


class LargeTask(ClassifierTask):
    """References are of the crops' size, and so are the images of the loss; states are larger."""

    def step(self, samples: list[Sample], states: list[State]) -> Stepped:
        """See `ClassifierTask`."""
        done, display = super().step([_enlarged(s) for s in samples], states), samples[0].view.display
        images = [
            downsample(image, display, state[-1].abs())
            for image, state in zip(
                done.images.split_with_sizes([1] * len(samples)), done.states, strict=True
            )
        ]
        weight = done.weight if isinstance(done.weight, float) else of_size(done.weight, display)
        return done._replace(images=torch.cat(images), weight=weight)


def _enlarged(sample: Sample) -> Sample:
    """Return the sample with the view and classes of the larger image."""
    display = Size(*large_size(sample.view.display))
    ghost, alias = (of_size(classes[None], display)[0] for classes in (sample.ghost, sample.alias))
    return sample._replace(view=sample.view._replace(display=display), ghost=ghost, alias=alias)
