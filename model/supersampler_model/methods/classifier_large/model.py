"""`classifier-large`: `classifier` with a history, and images of its own, larger than the display.

Each frame resamples the history, which blurs it and lets fine detail alias. A history of 1.4 times the
display's width and height loses less, as Unreal Engine's Temporal Super Resolution does with history
screen percentages over 100 ("TSR", SIGGRAPH 2022). The image is downsampled for the display.
"""

from typing import ClassVar, Self

from torch import Tensor

from supersampler.methods.classifier_large.spec import CLASSIFIER_LARGE
from supersampler.methods.spec import LARGE_HALF
from supersampler_model.methods.base import Fused
from supersampler_model.methods.classifier.buffers import Gathered
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.transfer import transferred
from supersampler_model.methods.weights_file import Trained
from supersampler_model.ops.downsampling import downsample
from supersampler_model.ops.sampling import of_size
from supersampler_model.ops.size import Size, display_size_of


class LargeClassifier(Classifier):
    """`Classifier` at 1.4 times the display, and a filter."""

    spec: ClassVar = CLASSIFIER_LARGE

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

    def fused(self) -> Fused | None:
        """Return the network of `Classifier`, at half the size of the history."""
        network = super().fused()
        assert network is not None  # noqa: S101 - `Classifier` has one
        inputs, outputs = (
            {name: (*shape[:2], *LARGE_HALF) for name, shape in shapes.items()}
            for shapes in (network.inputs, network.outputs)
        )
        return network._replace(inputs=inputs, outputs=outputs)

    def compute(
        self,
        color: Tensor,
        depth: Tensor,
        motion: Tensor,
        reactive: Tensor,
        jitter: Tensor,
        exposure: Tensor,
        display_size: Tensor,
        *others: Tensor,
    ) -> tuple[Tensor, ...]:
        """See `Classifier`."""
        large = (1.4 * display_size + 0.9).floor().long()  # integer division is not portable
        image, *rest = super().compute(color, depth, motion, reactive, jitter, exposure, large, *others)
        count, display = len(self.history), display_size_of(display_size)
        weight, frozen = rest[count:]
        return (image, *rest[:count], of_size(weight, display), frozen)

    def displayed(self, image: Tensor, display: Size, gathered: Gathered) -> Tensor:
        """See `Classifier`."""
        return downsample(image, display, gathered.exposure)
