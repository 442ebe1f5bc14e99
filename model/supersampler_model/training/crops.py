"""Random crops of training sequences, augmented: flips, transposition, colours, exposure, noise.

A crop of the display reads a crop of the render-size input. Its `View` has a jitter that includes the offset
between both, so that crops at any ratio are sampled as exactly as whole frames. A crop is a screen of its
own: pixels that are reprojected outside of it have no history.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.data.labels import Alias
from supersampler_model.ops.color import MAX_HALF
from supersampler_model.ops.sampling import Extent, View
from supersampler_model.ops.size import Size
from supersampler_model.training.frame_inputs import planes
from supersampler_model.training.path_noise import PathNoise

MARGIN = 3  # render pixels around the region that a crop reads
CANDIDATES = 3  # random regions per crop, of which the one with the most aliased pixels is used
FIREFLY_CHANCE = 0.03  # fraction of the frames with fireflies
MAX_EXPOSURE_CHANGE = 1.0  # in augmentation, stops


class Sample(NamedTuple):
    """One frame of a crop."""

    color: Tensor  # (1, 3, h, w) linear RGB
    depth: Tensor  # (1, 1, h, w)
    motion: Tensor  # (1, 2, h, w) render pixels
    exposure: Tensor  # (1,)
    view: View
    reset: bool
    reference: Tensor  # (1, 3, H, W) linear RGB
    ghost: Tensor  # (1, H, W) int64
    alias: Tensor  # (1, H, W) int64
    gbuffer: Mapping[str, Tensor] = MappingProxyType({})  # by input name
    unshaded: bool = False  # whether the method must extrapolate its colour

    def without_truth(self) -> Self:
        """Return the sample without reference, classes and reset: what a method reads."""
        none = self.exposure.new_empty(0)
        return self._replace(reset=False, reference=none, ghost=none, alias=none)

    def on(self, device: torch.device) -> Self:
        """Return the sample with its tensors on `device`."""
        moved = self._asdict()
        moved |= {name: value.to(device) for name, value in moved.items() if isinstance(value, Tensor)}
        moved["view"] = self.view._replace(jitter=self.view.jitter.to(device))
        moved["gbuffer"] = {name: value.to(device) for name, value in self.gbuffer.items()}
        return self._replace(**moved)


@dataclass(frozen=True)
class CropRegion:
    """Region and augmentation of a crop; the same for all of its frames.

    Attributes:
        left, top: corner in display pixels.
        size: of the crop in display pixels, both ways.
        ratio: display over render size, per axis.
        flip: whether columns, rows are reversed.
        turned: whether rows and columns are swapped.
        colors: order of the colour channels.
        gain: multiplies colours.
        exposure: multiplies the exposure.
    """

    left: int
    top: int
    size: int
    ratio: tuple[float, float]
    flip: tuple[bool, bool] = (False, False)
    turned: bool = False
    colors: tuple[int, int, int] = (0, 1, 2)
    gain: float = 1.0
    exposure: float = 1.0

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame."""
        return self._part(frame, *self._visible(frame), reset=reset)

    def worth(self, frame: TrainingFrame) -> int:
        """Return the number of aliased pixels in the crop."""
        crop = frame.alias[self.display]
        return int(((crop == Alias.GEOMETRY) | (crop == Alias.TEXTURE)).sum())

    @property
    def display(self) -> tuple[slice, slice]:
        """Rows and columns of the crop in an image of display size."""
        return slice(self.top, self.top + self.size), slice(self.left, self.left + self.size)

    def turn(self, image: NDArray[Any]) -> NDArray[Any]:
        """Flip and turn (height, width, ...)."""
        image = image[:, ::-1] if self.flip[0] else image
        image = image[::-1] if self.flip[1] else image
        return image.swapaxes(0, 1) if self.turned else image

    def _visible(self, frame: TrainingFrame) -> tuple[slice, slice]:
        """Columns and rows of the render-size region that the crop reads."""
        width, height = frame.depth.shape[::-1]
        across = _visible(self.left, self.size, self.ratio[0], width)
        return across, _visible(self.top, self.size, self.ratio[1], height)

    def _part(self, frame: TrainingFrame, across: slice, down: slice, *, reset: bool) -> Sample:
        """Cut the crop out, with these columns and rows at render size."""
        here = down, across
        corners = zip(frame.jitter, (across, down), (self.left, self.top), self.ratio, strict=True)
        jitter = [j + part.start - corner / ratio for j, part, corner, ratio in corners]
        motion = frame.motion[here].astype(np.float32)
        ratio, inner = list(self.ratio), [part.stop - part.start for part in (across, down)]
        for axis, flipped in enumerate(self.flip):
            if flipped:
                jitter[axis] = self.size / ratio[axis] - inner[axis] - jitter[axis]
                motion[..., axis] *= -1.0
        if self.turned:
            jitter, ratio, motion = jitter[::-1], ratio[::-1], motion[..., ::-1]

        def classes(image: NDArray[np.uint8]) -> Tensor:
            return torch.from_numpy(self.turn(image[self.display]).astype(np.int64))[None]

        colors = list(self.colors)
        return Sample(
            color=planes(self.turn(frame.color[here]))[:, colors] * self.gain,
            depth=planes(self.turn(frame.depth[here])),
            motion=planes(self.turn(motion)),
            exposure=torch.tensor([frame.exposure * self.exposure / self.gain], dtype=torch.float32),
            view=View(
                Size(self.size, self.size),
                Extent(self.size / ratio[0], self.size / ratio[1]),
                torch.tensor([jitter], dtype=torch.float32),
            ),
            reset=reset,
            reference=planes(self.turn(frame.reference[self.display]))[:, colors] * self.gain,
            ghost=classes(frame.ghost),
            alias=classes(frame.alias),
        )


Draw = Callable[[np.random.Generator, SequenceEntry, tuple[int, int], int], CropRegion]
"""Draws a random region: generator, sequence, its display size, size of the crop."""


def draw_region(
    random: np.random.Generator,
    entry: SequenceEntry,
    display_size: tuple[int, int],
    size: int,
    *,
    step: int = 1,
) -> CropRegion:
    """Draw a random region and augmentation, with corners at multiples of `step`."""
    width, height = display_size
    render = entry.render_size(display_size)
    r, g, b = (int(i) for i in random.permutation(3))
    return CropRegion(
        left=step * int(random.integers((width - size) // step + 1)),
        top=step * int(random.integers((height - size) // step + 1)),
        size=size,
        ratio=(width / render[0], height / render[1]),
        flip=(bool(random.integers(2)), bool(random.integers(2))),
        turned=bool(random.integers(2)),
        colors=(r, g, b),
        gain=float(2.0 ** random.uniform(-2.0, 2.0)),  # methods must not depend on the unit of light
        exposure=float(2.0 ** random.uniform(-MAX_EXPOSURE_CHANGE, MAX_EXPOSURE_CHANGE)),
    )


def with_fireflies(sample: Sample, random: np.random.Generator) -> Sample:
    """Add fireflies of random brightness to a few frames.

    Path tracers and broken shaders produce such samples for one frame. Rendered training data has none, and a
    network that never saw one keeps it for a second.
    """
    if random.random() >= FIREFLY_CHANCE:
        return sample
    fraction, stops = 10.0 ** random.uniform(-3.0, -1.0), random.uniform(3.0, 16.0)
    is_firefly = torch.from_numpy(random.random(sample.depth.shape) < fraction)
    light = torch.tensor(2.0**stops, dtype=torch.float32) / sample.exposure
    return sample._replace(color=torch.where(is_firefly, light.clamp(max=MAX_HALF), sample.color))


@dataclass
class Place:
    """Position of a stream, from which it resumes: number of the crop, and of the frame in it."""

    crop: int = 0
    frame: int = 0


class Stream:
    """An endless stream of crops of one split: crop after crop, the frames of each in order.

    Args:
        datasets: sets as `supersampler render` makes them.
        ratios: minimum and maximum ratio.
        size: of the crops, display pixels.
        seed: of the random choices; two streams of the same seed and place are the same.
        draw: returns one random region; called CANDIDATES times per crop.

    Raises:
        ArgumentError: no sequence can be trained on, or crops are larger than a display.
    """

    def __init__(
        self,
        datasets: Sequence[Dataset],
        *,
        ratios: tuple[float, float],
        size: int,
        seed: Sequence[int],
        draw: Draw = draw_region,
    ) -> None:
        self._sequences = sequences_of(datasets, ratios, least=2)
        smallest = min(min(dataset.description.display_size) for dataset, _, _ in self._sequences)
        if size > smallest:
            raise ArgumentError("size", got=size, want=f"at most {smallest}, the smaller side of a display")
        self._size, self._seed, self._draw = size, list(seed), draw
        self.place = Place()

    def __iter__(self) -> Iterator[Sample]:
        while True:
            random = np.random.default_rng([*self._seed, self.place.crop])
            dataset, entry, count = self._sequences[int(random.integers(len(self._sequences)))]
            first = int(random.integers(max(count // 3, 1)))
            display_size = dataset.description.display_size
            regions = [self._draw(random, entry, display_size, self._size) for _ in range(CANDIDATES)]
            first_frame = dataset.read(entry, first)
            region = max(regions, key=lambda region: region.worth(first_frame))
            noise = PathNoise.draw(random)
            for index in range(first + self.place.frame, count):
                frame = dataset.read(entry, index)
                self.place.frame += 1
                sample = region.sample(frame, reset=frame.reset or index == first)
                of_frame = np.random.default_rng([*self._seed, self.place.crop, index])
                if noise is not None:
                    sample = sample._replace(color=noise.on(sample.color, of_frame))
                yield with_fireflies(sample, of_frame)
            self.place = Place(self.place.crop + 1, 0)


def sequences_of(
    datasets: Sequence[Dataset], ratios: tuple[float, float], *, least: int
) -> list[tuple[Dataset, SequenceEntry, int]]:
    """Return the sequences to train on, with the number of their frames.

    Args:
        datasets: that they are of.
        ratios: minimum and maximum.
        least: minimum number of consecutive frames.

    Raises:
        ArgumentError: there are none.
    """
    found = [
        (dataset, entry, count)
        for dataset in datasets
        for entry in dataset.entries("train")
        if entry.within(ratios) and (count := dataset.complete(entry)) >= least
    ]
    if not found:
        want = f"{least} frames in a row to train on, at a ratio from {ratios[0]} to {ratios[1]}"
        raise ArgumentError("data", got="nothing of use", want=want)
    return found


def _visible(corner: int, size: int, ratio: float, extent: int) -> slice:
    """Samples that display pixels from `corner` on read, with a margin; as many at each corner."""
    first = int(np.floor((corner + 0.5) / ratio - 1.0)) - MARGIN
    count = min(int(np.ceil(size / ratio)) + 2 * MARGIN + 4, extent)
    first = min(max(first, 0), extent - count)
    return slice(first, first + count)
