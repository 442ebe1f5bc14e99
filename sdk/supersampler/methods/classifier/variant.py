"""What of a `classifier` its kernels are made for, and where that puts things."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self


class Variant(NamedTuple):
    """What kernels leave out where it is not set: its planes, reads and arithmetic.

    The first two are of ClassifierConfig; `guided` is that the frame has G-buffers of display size, as
    `gbuffer-fast` reads them. Properties are indices of planes of `Gathered.rest` and of blend parameters.
    """

    rectified: bool
    own_motion: bool
    guided: bool = False

    @classmethod
    def of(cls, config: Mapping[str, Any], *, guided: bool = False) -> Self:
        """Return that of a model."""
        return cls(**{name: config[name] for name in cls._fields[:2]}, guided=guided)

    @classmethod
    def with_parts(cls, *parts: str) -> Self:
        """Return that in which these are set."""
        return cls(*(name in parts for name in cls._fields))

    def kernel(self, name: str) -> str:
        """Return the name of its kernel, as the compiler takes it."""
        return f"{name}+" + "+".join(field for field, there in self._asdict().items() if there)

    @property
    def mean(self) -> int:
        """Of `rest`: mean and reach of the box, YCoCg."""
        return 14

    @property
    def own(self) -> int:
        """Of `rest`: the history warped by the pixel's own motion."""
        return self.mean + 6 * self.rectified

    @property
    def sampled(self) -> int:
        """Of `rest`: 1 where one of the samples around is usable, else 0."""
        return self.own + 3 * self.own_motion

    @property
    def rest(self) -> int:
        """Planes of `rest`."""
        return self.sampled + self.guided

    @property
    def history_colors(self) -> int:
        """History colours; of `blend_parameters`, the weights of those of this frame follow theirs."""
        return 1 + self.rectified + self.own_motion

    @property
    def sharpness(self) -> int:
        """Of `blend_parameters`, after the weights; the kernel follows."""
        return self.history_colors + 3

    @property
    def kernel_weights(self) -> int:
        """Of `blend_parameters`: nine."""
        return self.sharpness + 1

    @property
    def blend_parameters(self) -> int:
        """Number of blend parameters of a pixel."""
        return self.kernel_weights + 9

    @property
    def outputs(self) -> int:
        """Of the last layer: `blend_parameters` of four pixels, in eights."""
        return -(-4 * self.blend_parameters // 8) * 8
