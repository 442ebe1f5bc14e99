"""Names of all methods, and facts of those whose weights do not ship; for commands, without torch."""

from collections.abc import Mapping
from typing import NamedTuple

from supersampler.methods.gbuffers import GBUFFERS

FIXED = ("bilinear", "bicubic", "taa", "taau", "guided-warp")
"""Methods without anything learned."""
LEARNED = (
    "classifier", "classifier-small", "classifier-paper", "extrapolate", "gbuffer", "gbuffer-4x",
    "gbuffer-small", "gbuffer-small-4x", "gbuffer-depth", "guided-flow",
)  # fmt: skip
"""Methods that are trained."""


class UntrainedMethod(NamedTuple):
    """A method that is trained, of which no weights ship.

    Attributes:
        source: the paper that it follows.
        ratios: least and largest ratio of display to render size, per axis.
        gbuffers: names of those that it reads.
    """

    source: str
    ratios: tuple[float, float]
    gbuffers: tuple[str, ...] = ()


_WANG = "Wang et al. 2025 (docs/methods.md)"
UNTRAINED: Mapping[str, UntrainedMethod] = {
    "classifier-paper": UntrainedMethod("Guo, Chen, Dong and Tong 2022, supplement", (1.0, 3.0)),
    "gbuffer": UntrainedMethod(_WANG, (2.0, 2.0), tuple(GBUFFERS)),
    "gbuffer-4x": UntrainedMethod(_WANG, (4.0, 4.0), tuple(GBUFFERS)),
    "gbuffer-depth": UntrainedMethod(_WANG, (2.0, 2.0), ("gbuffer_display_depth",)),
}


def listed_methods(names: tuple[str, ...]) -> str:
    """Return names with commas between; those of which no weights ship are marked."""
    return ", ".join(f"{name} (no weights ship)" if name in UNTRAINED else name for name in names)
