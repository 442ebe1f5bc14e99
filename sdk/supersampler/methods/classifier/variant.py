"""`Variant`: parts of the compositor of `classifier`, and where its blend parameters are."""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self


class Variant(NamedTuple):
    """Compile-time variant of kernels and shaders: they leave out the arithmetic of what is not set.

    The first two are fields of ClassifierConfig. `guided`: the frame has display-size G-buffers, as for
    `gbuffer-fast`.
    """

    rectified: bool
    own_motion: bool
    guided: bool = False

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the variant of a model with this config."""
        return cls(config["rectified"], config["own_motion"])

    @property
    def history_colors(self) -> int:
        """History colours; of the blend parameters, the weights of this frame's colours follow theirs."""
        return 1 + self.rectified + self.own_motion

    @property
    def sharpness(self) -> int:
        """Index of the sharpness among the blend parameters, after the weights."""
        return self.history_colors + 3

    @property
    def kernel_weights(self) -> int:
        """First of the nine weights of the kernel among the blend parameters."""
        return self.sharpness + 1

    @property
    def blend_parameters(self) -> int:
        """Number of blend parameters of a pixel."""
        return self.kernel_weights + 9

    @property
    def outputs(self) -> int:
        """Outputs of the last layer: `blend_parameters` of four pixels, up to a multiple of eight."""
        return -(-4 * self.blend_parameters // 8) * 8
