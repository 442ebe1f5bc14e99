"""Crops for methods of one whole ratio that read G-buffers, at render size and at display size.

Such a crop consists of whole render pixels and is a small frame: it has the frame's jitter, each render pixel
covers the same square of display pixels, and nothing is read around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.training.crops import CropRegion, Sample, Stream, draw_region
from supersampler_model.training.frame_inputs import gbuffers, planes


@dataclass(frozen=True, eq=False)
class GBufferRegion(CropRegion):
    """A region of frames with G-buffers.

    Attributes:
        world: (3, 3) orthogonal matrix applied to normals: methods may only use their differences.
    """

    world: Float32 = field(default_factory=lambda: np.eye(3, dtype=np.float32))

    def _surfaces(self, frame: TrainingFrame, across: slice, down: slice) -> dict[str, Tensor]:
        """Cut out all G-buffers of the frame; those of render size with these columns and rows."""
        parts = {
            name: image[self.display if GBUFFERS[name].of_display else (down, across)]
            for name, image in gbuffers(frame).items()
        }
        return {name: planes(self.turn(self._varied(name, part))) for name, part in parts.items()}

    def _varied(self, name: str, image: NDArray[Any]) -> NDArray[Any]:
        if name.endswith("base_color"):
            return image[..., list(self.colors)]
        if name.endswith("normal"):
            return image.astype(np.float32) @ self.world.T
        return image


class AlignedGBufferRegion(GBufferRegion):
    """Region of which corner and size are multiples of its ratio, a whole number equal on both axes."""

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame, with all G-buffers that it has."""
        ratio = round(self.ratio[0])
        across, down = (slice(c // ratio, (c + self.size) // ratio) for c in (self.left, self.top))
        gbuffer = self._surfaces(frame, across, down)
        return self._part(frame, across, down, reset=reset)._replace(gbuffer=gbuffer)


def draw_aligned_region(
    random: np.random.Generator, entry: SequenceEntry, display_size: tuple[int, int], size: int
) -> AlignedGBufferRegion:
    """Draw a random region at a whole ratio, with augmentation and rotated normals."""
    cut = draw_region(random, entry, display_size, size, step=round(entry.ratio))
    return AlignedGBufferRegion(**vars(cut), world=draw_rotation(random))


def draw_rotation(random: np.random.Generator) -> Float32:
    """Draw a (3, 3) orthogonal matrix from the uniform distribution (Mezzadri 2007)."""
    q, r = np.linalg.qr(random.normal(size=(3, 3)))
    return (q * np.sign(np.diag(r))).astype(np.float32)


def gbuffer_stream(datasets: Sequence[Dataset], *, ratio: int, size: int, seed: Sequence[int]) -> Stream:
    """Stream crops with G-buffers of data sets that `gbuffer_set` returned; see `Stream`.

    Raises:
        ArgumentError: as `Stream`, and where `size` is no multiple of `ratio`.
    """
    if size % ratio:
        raise ArgumentError("size", got=size, want=f"a multiple of {ratio}, the ratio of the method")
    return Stream(datasets, ratios=(ratio, ratio), size=size, seed=seed, draw=draw_aligned_region)


def gbuffer_set(dataset: Dataset, ratio: int) -> Dataset:
    """Return a data set with the sequences rendered at one ratio, with G-buffers of both sizes.

    Raises:
        ArgumentError: there are none, or a render pixel is no whole number of display pixels.
    """
    at, size = dataset.at(ratio), dataset.description.display_size
    if size[0] % ratio or size[1] % ratio:
        want = f"a set whose display size is a multiple of {ratio}, the ratio of the method"
        raise ArgumentError("data", got=f"{dataset.folder}, of {size[0]}x{size[1]}", want=want)
    rendered = any(at.complete(entry) for entry in at.entries())
    if not dataset.description.gbuffers or not rendered:
        missing = (
            f"anything at ratio {ratio}" if dataset.description.gbuffers else "G-buffers of display size"
        )
        want = f"a set made by `supersampler render --gbuffers --also {ratio}`"
        raise ArgumentError("data", got=f"{dataset.folder}, without {missing}", want=want)
    return at
