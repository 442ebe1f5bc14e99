"""Random crops of training sequences, augmented: flips, transposition, colours, exposure, noise.

A crop of the display reads a crop of the render-size input. The jitter of its `View` includes the offset
between the two, so that crops at any ratio are sampled as exactly as whole frames. A crop is its own screen:
pixels that are reprojected outside of it have no history.

Methods of a fixed integer ratio (`gbuffer`) read G-buffers of render and of display size. Their crops are
`aligned`: they consist of whole render pixels, have the frame's jitter and read no pixels around the crop.
Methods of any ratio read G-buffers of render size, to extrapolate unshaded frames (`extrapolate`), or of both
sizes (`gbuffer-fast`).
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.display import MAX_HALF
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, TrainingFrame
from supersampler_model.data.labels import Alias
from supersampler_model.training.datasets import gbuffers, planes, sequences_of

MARGIN = 3  # render pixels around the region that a crop reads
CANDIDATES = 3  # random regions per crop; the one with the most aliased pixels is used
FIREFLY_CHANCE = 0.03  # fraction of the frames with fireflies
MAX_EXPOSURE_CHANGE = 1.0  # in augmentation, stops
TWO_UNSHADED = 0.25
"""Fraction of the crops with two unshaded frames after each shaded one; the others have one."""
NOISE_CHANCE = 0.06  # fraction of the crops with path-tracing noise
SAMPLES = 1, 2, 4, 8, 16  # a pixel
MIN_SPREAD, MAX_SPREAD = 0.6, 1.3  # of `PathNoise.spread`
MAX_CERTAIN, MAX_MISSED = 0.8, 0.3  # in half of the crops with noise, `missed` is 0
GBufferSizes = Literal["none", "render", "both"]
"""Sizes of the G-buffers of a crop."""


class CropFrame(NamedTuple):
    """One frame of a crop."""

    color: Tensor  # (1, 3, h, w) linear RGB
    depth: Tensor  # (1, 1, h, w)
    motion: Tensor  # (1, 2, h, w) render pixels
    exposure: Tensor  # (1,)
    view: ops.View
    reset: bool
    reference: Tensor  # (1, 3, H, W) linear RGB
    ghost: Tensor  # (1, H, W) uint8
    alias: Tensor  # (1, H, W) uint8
    gbuffer: Mapping[str, Tensor] = MappingProxyType({})  # by input name
    unshaded: bool = False  # whether the method must extrapolate its colour

    def without_truth(self) -> Self:
        """Return the part of the frame that a method reads: no reference, classes and reset."""
        none = self.exposure.new_empty(0)
        return self._replace(reset=False, reference=none, ghost=none, alias=none, gbuffer=dict(self.gbuffer))


@dataclass(frozen=True, eq=False)
class CropRegion:
    """Region and augmentation of a crop, for all of its frames."""

    left: int  # display pixels
    top: int
    size: int  # width and height, display pixels
    flip: tuple[bool, bool] = (False, False)  # whether columns, rows are reversed
    turned: bool = False  # whether rows and columns are swapped
    colors: tuple[int, int, int] = (0, 1, 2)  # order of the colour channels
    gain: float = 1.0  # factor of colours
    exposure: float = 1.0  # factor of the exposure
    gbuffers: GBufferSizes = "none"  # sizes of the crop's G-buffers, if the frame has them
    aligned: bool = False  # whether corner and size are multiples of the ratio, an integer for both axes
    world: Float32 = field(default_factory=lambda: np.eye(3, dtype=np.float32))
    """(3, 3) orthogonal matrix applied to normals: methods must only depend on their differences."""

    @classmethod
    def draw(
        cls,
        random: np.random.Generator,
        entry: SequenceEntry,
        display_size: tuple[int, int],
        size: int,
        *,
        gbuffers: GBufferSizes = "none",
        aligned: bool = False,
    ) -> Self:
        """Draw a random region of a sequence, and its augmentation."""
        (width, height), step = display_size, round(entry.ratio) if aligned else 1
        r, g, b = (int(i) for i in random.permutation(3))
        values: dict[str, Any] = {
            "left": step * int(random.integers((width - size) // step + 1)),
            "top": step * int(random.integers((height - size) // step + 1)),
            "flip": (bool(random.integers(2)), bool(random.integers(2))),
            "turned": bool(random.integers(2)),
            "gain": float(2.0 ** random.uniform(-2.0, 2.0)),  # methods must not depend on the unit of light
            "exposure": float(2.0 ** random.uniform(-MAX_EXPOSURE_CHANGE, MAX_EXPOSURE_CHANGE)),
        }
        if gbuffers != "none":
            q, upper = np.linalg.qr(random.normal(size=(3, 3)))  # uniform rotations (Mezzadri 2007)
            values["world"] = (q * np.sign(np.diag(upper))).astype(np.float32)
        return cls(size=size, colors=(r, g, b), gbuffers=gbuffers, aligned=aligned, **values)

    def cut(self, frame: TrainingFrame, *, reset: bool) -> CropFrame:
        """Cut the crop out of one frame, with the G-buffers that the frame has."""
        down, across = here = self.render_region(frame)
        ratio = list(_ratio(frame))
        corners = zip(frame.jitter, (across, down), (self.left, self.top), ratio, strict=True)
        jitter = [j + part.start - corner / ratio for j, part, corner, ratio in corners]
        motion = frame.motion[here].astype(np.float32)
        inner = [part.stop - part.start for part in (across, down)]
        for axis, flipped in enumerate(self.flip):
            if flipped:
                jitter[axis] = self.size / ratio[axis] - inner[axis] - jitter[axis]
                motion[..., axis] *= -1.0
        if self.turned:
            jitter, ratio, motion = jitter[::-1], ratio[::-1], motion[..., ::-1]

        def classes(image: NDArray[np.uint8]) -> Tensor:
            return torch.from_numpy(self.turn(image[self.display]).copy())[None]

        colors = list(self.colors)
        return CropFrame(
            color=planes(self.turn(frame.color[here]))[:, colors] * self.gain,
            depth=planes(self.turn(frame.depth[here])),
            motion=planes(self.turn(motion)),
            exposure=torch.tensor([frame.exposure * self.exposure / self.gain], dtype=torch.float32),
            view=ops.View(
                ops.Size(self.size, self.size),
                ops.Extent(self.size / ratio[0], self.size / ratio[1]),
                torch.tensor([jitter], dtype=torch.float32),
            ),
            reset=reset,
            reference=planes(self.turn(frame.reference[self.display]))[:, colors] * self.gain,
            ghost=classes(frame.ghost),
            alias=classes(frame.alias),
            gbuffer=self.cut_gbuffers(frame),
        )

    def cut_gbuffers(self, frame: TrainingFrame) -> dict[str, Tensor]:
        """Cut the crop out of the G-buffers of one frame."""
        found = {}
        for name, image in gbuffers(frame).items() if self.gbuffers != "none" else ():
            of_display = GBUFFERS[name].of_display
            if of_display and self.gbuffers != "both":
                continue
            part = image[self.display if of_display else self.render_region(frame)]
            if name.endswith("base_color"):
                part = part[..., list(self.colors)]
            elif name.endswith("normal"):
                part = part.astype(np.float32) @ self.world.T
            found[name] = planes(self.turn(part))
        return found

    def aliased_pixels(self, frame: TrainingFrame) -> int:
        """Return the number of aliased pixels in the crop."""
        crop = frame.alias[self.display]
        return int(((crop == Alias.GEOMETRY) | (crop == Alias.TEXTURE)).sum())

    @property
    def display(self) -> tuple[slice, slice]:
        """Rows and columns of the crop in an image of display size."""
        return slice(self.top, self.top + self.size), slice(self.left, self.left + self.size)

    def render_region(self, frame: TrainingFrame) -> tuple[slice, slice]:
        """Return the rows and columns to read at render size, with a margin; their number is fixed."""

        def axis(corner: int, ratio: float, extent: int) -> slice:
            if self.aligned:
                return slice(corner // round(ratio), (corner + self.size) // round(ratio))
            first = int(np.floor((corner + 0.5) / ratio - 1.0)) - MARGIN
            count = min(int(np.ceil(self.size / ratio)) + 2 * MARGIN + 4, extent)
            first = min(max(first, 0), extent - count)
            return slice(first, first + count)

        (height, width), (across, down) = frame.depth.shape, _ratio(frame)
        return axis(self.top, down, height), axis(self.left, across, width)

    def turn(self, image: NDArray[Any]) -> NDArray[Any]:
        """Flip and turn (height, width, ...)."""
        image = image[:, ::-1] if self.flip[0] else image
        image = image[::-1] if self.flip[1] else image
        return image.swapaxes(0, 1) if self.turned else image


def _ratio(frame: TrainingFrame) -> tuple[float, float]:
    """Return display over render size, per axis."""
    (height, width), (display_height, display_width) = frame.depth.shape, frame.ghost.shape
    return display_width / width, display_height / height


class PathNoise(NamedTuple):
    """Path-tracing noise in the colour of crops, of equal parameters in all frames; references have none.

    A pixel is the mean of a few samples. Each sample has a certain part, which every path finds, and a random
    part: zero with some probability, else log-normal, with a tail of fireflies. Darker pixels have a smaller
    certain part. docs/training.md compares the quantiles of the noise with those of Mitsuba 3.
    """

    samples: int  # per pixel
    certain: float  # certain fraction of the light of the brightest pixels, [0, 1]
    missed: float  # probability that the random part of a sample is zero, [0, 1)
    spread: float  # standard deviation of the logarithm of the random part, > 0

    @classmethod
    def draw(cls, random: np.random.Generator) -> Self | None:
        """Draw the parameters of one crop; None for crops without noise."""
        if random.random() >= NOISE_CHANCE:
            return None
        return cls(
            samples=int(random.choice(SAMPLES)),
            certain=float(random.uniform(0.0, MAX_CERTAIN)),
            missed=float(max(random.uniform(-MAX_MISSED, MAX_MISSED), 0.0)),
            spread=float(random.uniform(MIN_SPREAD, MAX_SPREAD)),
        )

    def factors(self, certain: NDArray[np.float32], random: np.random.Generator) -> NDArray[np.float32]:
        """Return random factors of colours, of mean 1; the `certain` fraction of the light does not vary."""
        shape = self.samples, *certain.shape
        logarithm = self.spread * random.standard_normal(shape, np.float32) - 0.5 * self.spread**2
        found = random.random(shape, np.float32) >= self.missed
        uncertain = (np.exp(logarithm) * found).mean(axis=0, dtype=np.float32) / np.float32(1.0 - self.missed)
        factors: NDArray[np.float32] = certain + (1.0 - certain) * uncertain
        return factors

    def on(self, color: Tensor, random: np.random.Generator) -> Tensor:
        """Multiply a frame's colour, (1, 3, h, w) linear RGB, by noise."""
        luma = ops.luminance(color.clamp(min=0.0))
        certain = self.certain * luma / (luma + luma.mean() + 1e-12)
        return (color * torch.from_numpy(self.factors(certain.numpy(), random))).clamp(max=MAX_HALF)


def with_fireflies(frame: CropFrame, random: np.random.Generator) -> CropFrame:
    """Add fireflies of random brightness to a few frames.

    Path tracers and broken shaders produce such samples in single frames. Rendered training data has none. A
    network that has never seen a firefly keeps it in the history for a second.
    """
    if random.random() >= FIREFLY_CHANCE:
        return frame
    fraction, stops = 10.0 ** random.uniform(-3.0, -1.0), random.uniform(3.0, 16.0)
    is_firefly = torch.from_numpy(random.random(frame.depth.shape) < fraction)
    light = torch.tensor(2.0**stops, dtype=torch.float32) / frame.exposure
    return frame._replace(color=torch.where(is_firefly, light.clamp(max=MAX_HALF), frame.color))


@dataclass
class StreamPosition:
    """Position from which a stream resumes: numbers of the crop, and of the frame in it."""

    crop: int = 0
    frame: int = 0


class CropStream(ABC):
    """An endless stream of crops, frame by frame; `position` is where the next iteration begins."""

    def __init__(self) -> None:
        self.position = StreamPosition()

    @abstractmethod
    def __iter__(self) -> Iterator[Any]:
        """Yield frames from `position` on."""


class Stream(CropStream):
    """Crops of one split: crop after crop, the frames of each in order.

    The ratios of crops are within a minimum and a maximum; `size` is in display pixels. Streams with the same
    seed and position are equal. Aligned crops consist of whole render pixels, at one integer ratio.

    Raises:
        ArgumentError: no sequence can be trained on, crops are larger than a display, or the size of aligned
            crops is not a multiple of the ratio.
    """

    def __init__(
        self,
        datasets: Sequence[Dataset],
        *,
        ratios: tuple[float, float],
        size: int,
        seed: Sequence[int],
        gbuffers: GBufferSizes = "none",
        aligned: bool = False,
    ) -> None:
        super().__init__()
        if aligned and size % ratios[0]:
            want = f"a multiple of {ratios[0]:g}, the ratio of the method"
            raise ArgumentError("size", got=size, want=want)
        self._sequences = sequences_of(datasets, ratios, min_frames=2)
        smallest = min(min(dataset.description.display_size) for dataset, _, _ in self._sequences)
        if size > smallest:
            raise ArgumentError("size", got=size, want=f"at most {smallest}, the smaller side of a display")
        self._size, self._seed = size, list(seed)
        self._gbuffers: GBufferSizes = gbuffers
        self._aligned = aligned

    def __iter__(self) -> Iterator[CropFrame]:
        while True:
            random = np.random.default_rng([*self._seed, self.position.crop])
            dataset, entry, count = self._sequences[int(random.integers(len(self._sequences)))]
            first = int(random.integers(max(count // 3, 1)))
            place = entry, dataset.description.display_size, self._size
            draw = partial(CropRegion.draw, random, *place, gbuffers=self._gbuffers, aligned=self._aligned)
            first_frame = dataset.read(entry, first)
            regions = [draw() for _ in range(CANDIDATES)]
            region = max(regions, key=lambda region: region.aliased_pixels(first_frame))
            noise = PathNoise.draw(random)
            start = first + self.position.frame
            size = dataset.read(entry, start - 1).depth.shape if start > first else None  # of the last frame
            for index in range(start, count):
                frame = dataset.read(entry, index)
                self.position.frame += 1
                crop = region.cut(frame, reset=frame.reset or frame.depth.shape != size)
                size = frame.depth.shape
                of_frame = np.random.default_rng([*self._seed, self.position.crop, index])
                if noise is not None:
                    crop = crop._replace(color=noise.on(crop.color, of_frame))
                yield with_fireflies(crop, of_frame)
            self.position = StreamPosition(self.position.crop + 1, 0)


class UnshadedStream(Stream):
    """Crops in which every second frame is unshaded, or two of three; without G-buffers, all are shaded."""

    def __iter__(self) -> Iterator[CropFrame]:
        for crop in super().__iter__():
            random = np.random.default_rng([*self._seed, self.position.crop, 0, 1])
            unshaded = 2 if random.random() < TWO_UNSHADED else 1
            number = self.position.frame - 1  # the position already counts this frame
            unshaded_here = number % (unshaded + 1) > 0 and bool(crop.gbuffer) and not crop.reset
            yield crop._replace(unshaded=unshaded_here)
