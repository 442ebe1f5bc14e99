"""Training of `guided-flow` on crops of unshaded frames, by the error to their shaded colour.

Guided light (`methods.guided_warp`) takes far longer to compute than a step of the network. It is computed
once per frame and kept in memory, as half floats. The census loss of light (Wu et al. 2023, equations 8 and
9) is not used: with it, the network fitted the noise of light and inferred no motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.io.display import MAX_HALF
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, TrainingFrame
from supersampler_model.data.labels import Ghost
from supersampler_model.methods.base import Method
from supersampler_model.methods.guided_flow import LIGHT, Gathered, GuidedFlow, flow_history
from supersampler_model.methods.guided_warp import GuidedWarp, reflectance, surface_of
from supersampler_model.training.crops import CropStream, StreamPosition
from supersampler_model.training.datasets import gbuffer_set, method_inputs, sequences_of
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.task import State, Stepped, Task, fast_convolutions
from supersampler_model.training.validation import ExtrapolationRunner, SequenceRunner

RATIO = 2  # of second renderings of data sets, with G-buffers of render size
PATTERNS = ((0, 1), (1, 1), (0, 2))
"""Index of the first shaded frame, and number of unshaded frames after each shaded one."""
MIN_FRAMES = 4  # of a sequence, for a frame with two shaded frames before it
HALF_CHANNELS = [LIGHT, 3]  # at half size: later input, earlier light
FULL_CHANNELS = [3, 4, 3, 3, 1]  # guided light, guides, reflectance, own colour, 1 where light changed
MIN_CHANCE = 1e-3  # added to the fraction of pixels whose light changed: the sampling weight of a frame
MAX_EXPOSURE_CHANGE = 1.0  # in augmentation, stops


class LightCrop(NamedTuple):
    """A crop of one unshaded frame; (1, ., h, w) unless stated otherwise."""

    later: Tensor  # (1, LIGHT, h / 2, w / 2) of the last shaded frame
    earlier: Tensor  # (1, LIGHT, h / 2, w / 2) of the one before
    light: Tensor  # guided light of the last shaded frame, times the exposure
    guides: Tensor  # see `GuidedFlow.guides`
    reflectance: Tensor
    reference: Tensor  # the shaded colour of the frame, linear RGB times its exposure
    changed: Tensor  # 1 where the lighting changed since the previous frame
    exposure: Tensor  # (1,) of the augmentation
    reset: bool = True  # every crop is a single frame


class LightFrames(NamedTuple):
    """Unshaded frames of a sequence, as half floats."""

    half: Tensor  # (n, HALF_CHANNELS, h / 2, w / 2)
    full: Tensor  # (n, FULL_CHANNELS, h, w), with exposed light and colour


class LightCache:
    """Computes the guided light of sequences by the gather stage of a method, and caches it."""

    def __init__(self, method: GuidedFlow) -> None:
        self._method = method
        self._kept: dict[tuple[str, SequenceEntry], LightFrames] = {}

    def of(self, dataset: Dataset, entry: SequenceEntry) -> LightFrames:
        """Return the unshaded frames of a sequence under each of the PATTERNS.

        Raises:
            ArgumentError: there are none.
        """
        key = str(dataset.folder), entry
        if key not in self._kept:
            frames = list(dataset.frames(entry))
            found = [light for pattern in PATTERNS for light in self._unshaded(frames, *pattern)]
            if not found:
                raise ArgumentError("data", got=f"{key}", want=f"{MIN_FRAMES} frames without a cut")
            self._kept[key] = LightFrames(*(torch.cat(parts) for parts in zip(*found, strict=True)))
        return self._kept[key]

    @torch.no_grad()
    def _unshaded(self, frames: Sequence[TrainingFrame], first: int, unshaded: int) -> Iterator[LightFrames]:
        """Yield the unshaded frames after two shaded ones without a cut."""
        method = self._method
        state: list[Tensor] = []
        count = 0  # frames since a cut
        for frame in frames[first:]:
            count = 0 if frame.reset else count
            given = method_inputs(frame, ["color", *method.inputs()])
            if count % (unshaded + 1) == 0:
                state = method.after_shaded(given, state if count else None)
            else:
                history, jitter = flow_history(*state), given["jitter"]
                surface = surface_of(given["gbuffer_base_color"], given["gbuffer_normal"], given["depth"])
                gathered = method.gather(
                    surface, given["gbuffer_roughness"], given["motion"], jitter, history
                )
                if count > unshaded + 1:
                    yield self._light_frame(frame, given["color"], gathered)
                state = method.next_history(gathered.motion, jitter, history)
            count += 1

    def _light_frame(self, frame: TrainingFrame, color: Tensor, gathered: Gathered) -> LightFrames:
        method, (later, earlier) = self._method, gathered.lights
        full = [
            ops.bounded(gathered.light.color * frame.exposure),
            method.guides(gathered.surface).clamp(-MAX_HALF, MAX_HALF),
            reflectance(gathered.surface, method.config.warp),
            ops.bounded(color * frame.exposure),
            changing_light(frame),
        ]
        return LightFrames(torch.cat([later, earlier[:, :3]], dim=1).half(), torch.cat(full, dim=1).half())


class LightStream(CropStream):
    """Crops of light from sets of `gbuffer_set`; frames with changing light are sampled more often.

    `ratio` is display over render size, `size` is in render pixels. Streams may share one cache of light.

    Raises:
        ArgumentError: no sequence can be trained on, or crops are larger than frames.
    """

    def __init__(
        self, datasets: Sequence[Dataset], lights: LightCache, *, ratio: int, size: int, seed: Sequence[int]
    ) -> None:
        super().__init__()
        self._sequences = sequences_of(datasets, (ratio, ratio), min_frames=MIN_FRAMES)
        smallest = min(min(dataset.description.display_size) for dataset, _, _ in self._sequences) // ratio
        if size > smallest - 2:
            raise ArgumentError("size", got=size, want=f"at most {smallest - 2}, less than a frame")
        self._lights, self._size, self._seed = lights, size // 2, list(seed)

    def __iter__(self) -> Iterator[LightCrop]:
        while True:
            random = np.random.default_rng([*self._seed, self.position.crop])
            dataset, entry, _ = self._sequences[int(random.integers(len(self._sequences)))]
            self.position = StreamPosition(self.position.crop + 1, 0)
            yield draw_light(random, self._lights.of(dataset, entry), self._size)


def draw_light(random: np.random.Generator, frames: LightFrames, size: int) -> LightCrop:
    """Cut a random, augmented crop out of unshaded frames; `size` is in pixels at half the render size."""
    chances = frames.full[:, -1].float().mean(dim=(1, 2)).numpy().astype(np.float64) + MIN_CHANCE
    index = int(random.choice(len(chances), p=chances / chances.sum()))
    corner = [1 + int(random.integers(many // 2 - size)) for many in frames.full.shape[2:]]
    flips = [bool(random.integers(2)) for _ in corner]
    turned = bool(random.integers(2))
    order = torch.from_numpy(random.permutation(3))
    exposure = 2.0 ** random.uniform(-MAX_EXPOSURE_CHANGE, MAX_EXPOSURE_CHANGE)

    def cut(images: Tensor, unit: int) -> Tensor:
        # Images of half size hold the first pixel of each pair, even if flipped.
        begins = [unit * at - (unit - 1) * flip for at, flip in zip(corner, flips, strict=True)]
        rows, columns = (slice(begin, begin + unit * size) for begin in begins)
        image = images[index : index + 1, :, rows, columns].float()
        image = image.flip([axis for axis, flip in zip((2, 3), flips, strict=True) if flip])
        return image.transpose(2, 3) if turned else image

    later, earlier = torch.split(cut(frames.half, 1), HALF_CHANNELS, dim=1)
    rough = later[:, 3:]
    later, earlier = (torch.cat([light[:, order], rough], dim=1) for light in (later, earlier))
    light, guides, reflects, color, changed = torch.split(cut(frames.full, 2), FULL_CHANNELS, dim=1)
    light, reflects, color = (part[:, order] for part in (light, reflects, color))
    exposed = torch.full((1,), exposure)
    return LightCrop(later, earlier, light, guides, reflects, color, changed, exposed)


def changing_light(frame: TrainingFrame) -> Tensor:
    """Return (1, 1, h, w): 1 where the label is a change of lighting since the previous frame, else 0."""
    axes = zip(frame.depth.shape[::-1], frame.ghost.shape[::-1], frame.jitter, strict=True)
    positions = [((np.arange(small) + 0.5 + jitter) * large / small, large) for small, large, jitter in axes]
    columns, rows = (at.astype(np.int64).clip(0, large - 1) for at, large in positions)
    relit = frame.ghost[np.ix_(rows, columns)] == Ghost.SHADING
    return torch.from_numpy(relit.astype(np.float32))[None, None]


@dataclass(frozen=True)
class FlowWeights(ImageWeights):
    """Weights of the loss terms; see `ImageWeights`."""

    rms: float = 3.0  # larger than the default: the prediction of unknown light should be its mean
    change: float = 0.0  # crops are single frames
    changed: float = 1.0  # extra weight of the error where the lighting changed


class FlowTask(Task):
    """Single unshaded frames without state."""

    method: GuidedFlow
    losses = FlowWeights()

    def __init__(self, method: GuidedFlow) -> None:
        super().__init__(method)
        self._lights = LightCache(method)

    @property
    def ratios(self) -> tuple[float, float]:
        """The ratio of the frames with G-buffers of render size, as minimum and maximum."""
        return float(RATIO), float(RATIO)

    @property
    def baseline(self) -> Method:
        """`guided-warp`, which the untrained method equals."""
        return GuidedWarp()

    def data(self, dataset: Dataset) -> Dataset:
        """Return a `gbuffer_set`."""
        return gbuffer_set(dataset, RATIO)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> LightStream:
        """Stream crops of light; all streams share one cache.

        Raises:
            ArgumentError: see `LightStream`; or the coarsest level of the network would be a single pixel,
                which batch normalisation does not support.
        """
        coarsest = 2 ** (len(self.method.config.network.levels) + 1)
        if size <= coarsest:
            raise ArgumentError("size", got=size, want=f"more than {coarsest}")
        return LightStream(datasets, self._lights, ratio=RATIO, size=size, seed=seed)

    def runner(self, method: Method, display: ops.Size) -> SequenceRunner:
        """Return a runner that extrapolates every second frame; only these are scored."""
        return ExtrapolationRunner(method, display)

    def first_state(self, crop: LightCrop) -> State:
        """Return no state."""
        del crop
        return []

    def step(self, crops: list[LightCrop], states: list[State]) -> Stepped:
        """Step all crops as one batch."""
        together = (torch.cat(parts) for parts in zip(*(crop[:-1] for crop in crops), strict=True))
        later, earlier, light, guides, reflectance, _, changed, _ = together
        with fast_convolutions(later.device, training=self.method.training):
            (inferred,) = self.method.net(later, earlier)
        light = self.method.refined(light, guides, inferred.float())
        return Stepped(light * reflectance, states, weight=1.0 + self.losses.changed * changed)
