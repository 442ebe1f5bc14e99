"""Scenes before a still camera whose light, screens and objects change, with the true image of each frame."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from supersampler import Frame, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform

FINE = 3
"""Side of the grid of truth samples in a display pixel."""
Values = NDArray[np.float64]
Pattern = Callable[[Values, Values], Values]
Light = Callable[[int], Any]
NOISE = np.random.default_rng(0).random((64, 64, 3)) ** 2


def flat(x: Values, _: Values) -> Values:
    return np.full((*x.shape, 3), 0.4)


def wave(x: Values, y: Values) -> Values:
    squares = (np.floor(x / 4) + np.floor(y / 4)) % 2
    red, green = 0.25 * np.sin(x / 5) * np.cos(y / 7), 0.2 * np.sin((x + y) / 3)
    return np.stack([0.3 + red, 0.3 + green, 0.25 + 0.2 * squares], -1)


def cells(x: Values, y: Values) -> Values:
    return np.asarray(NOISE[np.floor(y / 2).astype(int) % 64, np.floor(x / 2).astype(int) % 64])


def stripes(length: float, angle: float) -> Pattern:
    def pattern(x: Values, y: Values) -> Values:
        way = x * np.cos(angle) + y * np.sin(angle)
        return np.repeat((0.5 + 0.4 * np.sin(2 * np.pi * way / length))[..., None], 3, -1)

    return pattern


@dataclass(frozen=True)
class RestScene:
    """A pattern on a wall, lit as a whole or in part.

    Attributes:
        pattern: pattern of display pixels (x, y).
        light: factor of the frame's light, a number or RGB.
        place: "all" of the wall is lit so and scrolls, a round "spot", or what an "edge" has passed.
        speed: speed of the edge, and of the pattern in `place`, display pixels a frame; no vector has it.
        creep: motion of the camera, render pixels a frame, which motion vectors say.
        mover: whether a disc moves across, with motion vectors.
        render: (width, height) of the frames.
        ratio: display over render size.
    """

    pattern: Pattern
    light: Light = lambda _: 1.0
    place: str = "all"
    speed: float = 0.0
    creep: float = 0.0
    mover: bool = False
    render: Size = (48, 32)
    ratio: float = 2.0

    @property
    def display(self) -> Size:
        return round(self.render[0] * self.ratio), round(self.render[1] * self.ratio)

    @property
    def period(self) -> int:
        """Frames of a period of the jitter."""
        return jitter_phase_count(self.ratio)

    def frames(self, count: int) -> Iterator[tuple[Frame, Float32]]:
        """Yield frames, each with its true image (H, W, 3)."""
        (w, h), (width, height) = self.render, self.display
        y, x = np.mgrid[0 : height * FINE, 0 : width * FINE]
        fine = (x + 0.5) / FINE, (y + 0.5) / FINE
        rows, columns = np.mgrid[0:h, 0:w].astype(float)
        ground = self.pattern(*fine) if self._still else None
        for t in range(count):
            jitter = halton_jitter(t, self.ratio)
            at = (columns + 0.5 + jitter[0]) * width / w, (rows + 0.5 + jitter[1]) * height / h
            color, disc = self._light(t, *at)
            truth, _ = self._light(t, *fine, ground)
            truth = truth.reshape(height, FINE, width, FINE, 3).mean((1, 3))
            motion = np.zeros((h, w, 2), np.float32)
            motion[..., 0] = np.where(disc, -0.75, self.creep)
            depth = np.where(disc, 0.5, 0.1).astype(np.float32)
            color = color.astype(np.float32)
            yield (
                Frame(color=color, depth=depth, motion=motion, jitter=jitter, exposure=1.0, reset=t == 0),
                truth.astype(np.float32),
            )

    @property
    def _still(self) -> bool:
        return self.creep == 0.0 and (self.speed == 0.0 or self.place == "edge")

    def _light(
        self, t: int, x: Values, y: Values, ground: Values | None = None
    ) -> tuple[Values, NDArray[np.bool_]]:
        """Return the colour at points, and where the disc is."""
        if ground is None:
            ground = self.pattern(x + self.creep * self.ratio * t, y)
        moved = ground if self._still or self.speed == 0.0 else self.pattern(x + self.speed * t, y)
        lit = moved * np.asarray(self.light(t))
        if self.place == "spot":
            lit = np.where((np.hypot(x - 50, y - 30) < 14)[..., None], lit, ground)
        elif self.place == "edge":
            lit = np.where((x < 20 + self.speed * t)[..., None], lit, ground)
        disc = np.zeros(x.shape, bool)
        if self.mover:
            disc = np.hypot(x - 0.75 * self.ratio * t % 160, y - 20) < 7
            lit = np.where(disc[..., None], [0.7, 0.5, 0.2], lit)
        return lit, disc


def worse_by(image: Float32, own: Float32, truth: Float32) -> tuple[float, float]:
    """Return how much farther an image is from the truth than another, in 1/255: mean, 99.9 % quantile.

    The quantile is compared with 1.1 times the other's: of 6,000 pixels it is that of six, and behind what
    moves in front of noise these are off by 100/255 in either image, by chance of each frame.
    """
    ours, theirs = (np.abs(display_transform(i, 1.0) - display_transform(truth, 1.0)) for i in (image, own))
    quantiles = (float(np.quantile(error, 0.999)) for error in (ours, theirs))
    high, low = quantiles
    return 255.0 * float(ours.mean() - theirs.mean()), 255.0 * (high - 1.1 * low)


def _fade(start: int, length: int, depth: float) -> Light:
    return lambda t: 1.0 - depth * min(max(0, t - start), length) / length


def _hue(slow: float) -> Light:
    return lambda t: np.array([1 + 0.3 * np.sin(t / slow), 1 - 0.15 * np.sin(t / slow), 1.0])


_shares = st.floats(0.05, 0.6)
PATTERNS = st.one_of(
    st.sampled_from([flat, wave, cells]), st.builds(stripes, st.floats(2.6, 9.0), st.floats(0.2, 1.3))
)
"""Stripes along an axis are left out: where they scroll by half their length a frame, their samples are those
of a finer pattern that stands still, as every second jitter lies on one side of the pixel."""


def _blinking(frames: int, low: float) -> Light:
    return lambda t: 1.0 if t // frames % 2 else low


def _flashing(frames: int, low: float) -> Light:
    return lambda t: low if t % frames else 1.5


IN_STEP = (2, 3, 4, 8, 9, 16, 18, 32)
"""Divisors of the periods of the jitter at ratios 1.5 and 2."""
LIGHTS = st.one_of(
    st.just(lambda _: 1.0),
    st.builds(_fade, st.integers(0, 70), st.sampled_from([1, 2, 8, 32, 64, 200]), _shares),
    st.builds(_blinking, st.sampled_from([n for n in range(2, 20) if n not in IN_STEP]), _shares),
    st.builds(_flashing, st.sampled_from([n for n in range(2, 40) if n not in (*IN_STEP, 6)]), _shares),
    st.builds(
        lambda p, a: lambda t: 1.0 + a * np.sin(2 * np.pi * t / p),
        st.one_of(st.sampled_from([16, 18, 31, 32, 33, 48, 64]), st.floats(4.0, 90.0)),
        st.floats(0.03, 0.4),
    ),
    st.builds(lambda rate: lambda t: 1.0 + rate * t, st.floats(-0.004, 0.004)),
    st.builds(_hue, st.floats(10.0, 90.0)),
)
LIGHTS_IN_STEP = st.one_of(
    st.builds(_blinking, st.sampled_from(IN_STEP), _shares),
    st.builds(_flashing, st.sampled_from(IN_STEP), _shares),
)
"""In a few samples, light that blinks with a divisor of the jitter's period looks like a fine pattern: it is
drawn for the whole wall alone. Light that is on in every second frame is left out: a pattern of half a pixel
would have its samples."""


def _scenes(lights: st.SearchStrategy[Light], places: list[str]) -> st.SearchStrategy[RestScene]:
    return st.builds(
        RestScene,
        PATTERNS,
        lights,
        st.sampled_from(places),
        st.sampled_from([0.0, 0.0, 0.1, 0.2, 0.37, 1.0, 1.5]),
        st.sampled_from([0.0, 0.0, 0.0, 0.0038]),
        st.sampled_from([False, False, True]),
        st.sampled_from([(48, 32), (37, 27)]),
        st.sampled_from([1.5, 2.0]),
    )


SCENES = _scenes(LIGHTS, ["all", "spot", "edge"]) | _scenes(LIGHTS_IN_STEP, ["all"])
