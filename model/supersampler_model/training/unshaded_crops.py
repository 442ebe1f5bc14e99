"""Crops at any ratio with some unshaded frames, and the G-buffers of render size to extrapolate them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.training.crops import Sample, Stream, draw_region
from supersampler_model.training.gbuffer_crops import GBufferRegion, draw_rotation

TWO = 0.25
"""Fraction of the crops with two unshaded frames after each shaded one; the others have one."""


class RenderGBufferRegion(GBufferRegion):
    """Region with G-buffers of render size."""

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame."""
        across, down = self._visible(frame)
        found = self._surfaces(frame, across, down)
        gbuffer = {name: buffer for name, buffer in found.items() if not GBUFFERS[name].of_display}
        return self._part(frame, across, down, reset=reset)._replace(gbuffer=gbuffer)


class UnshadedStream(Stream):
    """Crops with every second frame unshaded, or two of three; crops without G-buffers are all shaded."""

    def __iter__(self) -> Iterator[Sample]:
        for sample in super().__iter__():
            random = np.random.default_rng([*self._seed, self.place.crop, 0, 1])
            unshaded = 2 if random.random() < TWO else 1
            number = self.place.frame - 1  # the place already counts this frame
            unshaded_here = number % (unshaded + 1) > 0 and bool(sample.gbuffer) and not sample.reset
            yield sample._replace(unshaded=unshaded_here)


def draw_render_region(
    random: np.random.Generator, entry: SequenceEntry, display_size: tuple[int, int], size: int
) -> RenderGBufferRegion:
    """Draw a random region with augmentation and rotated normals."""
    return RenderGBufferRegion(
        **vars(draw_region(random, entry, display_size, size)), world=draw_rotation(random)
    )


def unshaded_set(dataset: Dataset, ratios: tuple[float, float]) -> Dataset:
    """Return a data set with the sequences at each ratio within `ratios` that they are rendered at a second
    time.

    Raises:
        ArgumentError: there is none, so that no frame has G-buffers of render size.
    """
    slack, entries = 0.02, dataset.entries()
    found = [r for r in _rendered_ratios(dataset) if ratios[0] - slack <= r <= ratios[1] + slack]
    if not found:
        want = "a set made by `supersampler render --gbuffers --also 2`"
        got = f"{dataset.folder}, without G-buffers of render size at a ratio from {ratios[0]} to {ratios[1]}"
        raise ArgumentError("data", got=got, want=want)
    sequences = tuple(replace(entry, ratio=ratio) for ratio in found for entry in entries)
    return Dataset(dataset.folder, replace(dataset.description, sequences=sequences), own=dataset)


def _rendered_ratios(dataset: Dataset) -> list[float]:
    """Ratios that the first frame of any sequence is rendered at a second time."""
    there = set()
    for entry in dataset.entries():
        first = dataset.path(entry, 0)
        for path in first.parent.glob(f"{first.stem}.*x{first.suffix}"):
            there.add(float(path.name.removeprefix(f"{first.stem}.").removesuffix(f"x{first.suffix}")))
    return sorted(there)
