"""Crops of training frames with G-buffers.

Methods of a fixed integer ratio (`gbuffer`) read G-buffers of render and of display size. Their crops are
`aligned`: they consist of whole render pixels, have the frame's jitter and read no pixels around the crop.
Methods of any ratio read G-buffers of render size, to extrapolate unshaded frames (`extrapolate`), or of both
sizes (`gbuffer-fast`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.training.crops import CropRegion, Sample, Stream, draw_region
from supersampler_model.training.frame_inputs import gbuffers, planes

TWO_UNSHADED = 0.25
"""Fraction of the crops with two unshaded frames after each shaded one; the others have one."""


@dataclass(frozen=True, eq=False)
class GBufferRegion(CropRegion):
    """A region of frames with G-buffers.

    Attributes:
        world: (3, 3) orthogonal matrix applied to normals: methods may only use their differences.
        aligned: whether corner and size are multiples of the ratio, a whole number equal on both axes. The
            crop then has G-buffers of both sizes.
        of_display: whether a crop that is not aligned has them, too; otherwise it has those of render size.
    """

    world: Float32 = field(default_factory=lambda: np.eye(3, dtype=np.float32))
    aligned: bool = False
    of_display: bool = False

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame, with the G-buffers that the frame has."""
        across, down = self._visible(frame)
        if self.aligned:
            ratio = round(self.ratio[0])
            across, down = (slice(c // ratio, (c + self.size) // ratio) for c in (self.left, self.top))
        found = {}
        for name, image in gbuffers(frame).items():
            of_display = GBUFFERS[name].of_display
            if of_display and not (self.aligned or self.of_display):
                continue
            part = image[self.display if of_display else (down, across)]
            if name.endswith("base_color"):
                part = part[..., list(self.colors)]
            elif name.endswith("normal"):
                part = part.astype(np.float32) @ self.world.T
            found[name] = planes(self.turn(part))
        return self._part(frame, across, down, reset=reset)._replace(gbuffer=found)


def draw_gbuffer_region(
    random: np.random.Generator,
    entry: SequenceEntry,
    display_size: tuple[int, int],
    size: int,
    *,
    aligned: bool = False,
    of_display: bool = False,
) -> GBufferRegion:
    """Return a random region with augmentation, normals rotated; see `GBufferRegion`."""
    region = draw_region(random, entry, display_size, size, step=round(entry.ratio) if aligned else 1)
    q, r = np.linalg.qr(random.normal(size=(3, 3)))  # uniform over orthogonal matrices (Mezzadri 2007)
    world = (q * np.sign(np.diag(r))).astype(np.float32)
    return GBufferRegion(**vars(region), world=world, aligned=aligned, of_display=of_display)


def gbuffer_stream(datasets: Sequence[Dataset], *, ratio: int, size: int, seed: Sequence[int]) -> Stream:
    """Stream crops with G-buffers of data sets that `gbuffer_set` returned; see `Stream`.

    Raises:
        ArgumentError: as `Stream`, and where `size` is no multiple of `ratio`.
    """
    if size % ratio:
        raise ArgumentError("size", got=size, want=f"a multiple of {ratio}, the ratio of the method")
    draw = partial(draw_gbuffer_region, aligned=True)
    return Stream(datasets, ratios=(ratio, ratio), size=size, seed=seed, draw=draw)


def guided_stream(
    datasets: Sequence[Dataset], *, ratios: tuple[float, float], size: int, seed: Sequence[int]
) -> Stream:
    """Stream crops of any ratio with G-buffers of both sizes; see `Stream`."""
    draw = partial(draw_gbuffer_region, of_display=True)
    return Stream(datasets, ratios=ratios, size=size, seed=seed, draw=draw)


class UnshadedStream(Stream):
    """Crops with every second frame unshaded, or two of three; crops without G-buffers are all shaded.

    Args: see `Stream`.
    """

    def __init__(
        self, datasets: Sequence[Dataset], *, ratios: tuple[float, float], size: int, seed: Sequence[int]
    ) -> None:
        super().__init__(datasets, ratios=ratios, size=size, seed=seed, draw=draw_gbuffer_region)

    def __iter__(self) -> Iterator[Sample]:
        for sample in super().__iter__():
            random = np.random.default_rng([*self._seed, self.place.crop, 0, 1])
            unshaded = 2 if random.random() < TWO_UNSHADED else 1
            number = self.place.frame - 1  # the place already counts this frame
            unshaded_here = number % (unshaded + 1) > 0 and bool(sample.gbuffer) and not sample.reset
            yield sample._replace(unshaded=unshaded_here)


def gbuffer_set(dataset: Dataset, ratio: int) -> Dataset:
    """Return a data set with the sequences rendered at one ratio, with G-buffers of both sizes.

    Raises:
        ArgumentError: there are none, or a render pixel is no whole number of display pixels.
    """
    at, size = dataset.at(ratio), dataset.description.display_size
    if size[0] % ratio or size[1] % ratio:
        want = f"a set whose display size is a multiple of {ratio}, the ratio of the method"
        raise ArgumentError("data", got=f"{dataset.folder}, of {size[0]}x{size[1]}", want=want)
    missing = "" if any(map(at.complete, at.entries())) else f"frames at ratio {ratio}"
    missing = missing if dataset.description.gbuffers else "G-buffers of display size"
    if missing:
        want = f"a set made by `supersampler render --gbuffers --also {ratio}`"
        raise ArgumentError("data", got=f"{dataset.folder}, without {missing}", want=want)
    return at


def unshaded_set(dataset: Dataset, ratios: tuple[float, float]) -> Dataset:
    """Return a data set with the sequences at each ratio within `ratios` of their second renderings.

    Raises:
        ArgumentError: there is none, so that no frame has G-buffers of render size.
    """
    own = dataset.entries()
    names = (path.name for entry in own for path in dataset.path(entry, 0).parent.glob("0000.*x.safetensors"))
    rendered = {float(name.removeprefix("0000.").removesuffix("x.safetensors")) for name in names}
    sequences = tuple(replace(entry, ratio=ratio) for ratio in sorted(rendered) for entry in own)
    sequences = tuple(entry for entry in sequences if entry.within(ratios))
    if not sequences:
        want = "a set made by `supersampler render --gbuffers --also 2`"
        got = f"{dataset.folder}, without G-buffers of render size at a ratio from {ratios[0]} to {ratios[1]}"
        raise ArgumentError("data", got=got, want=want)
    return Dataset(dataset.folder, replace(dataset.description, sequences=sequences), own=dataset)
