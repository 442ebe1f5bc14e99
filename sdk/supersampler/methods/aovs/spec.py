"""Definition of `aovs`, the step that blends a frame's AOVs with the weights of the colour."""

from supersampler.methods.spec import CHANNELS, DISPLAY, MethodSpec

SIGMA = 0.35
"""Gaussian that upsamples this frame, render pixels."""
MIN_CERTAINTY = 1e-3
"""Sum of the weights of a channel's samples below which they are missing: the history is kept."""
UNKNOWN = 1e-30
"""Value of a channel that has had no sample since the history began, shown as it is: nearly 0. As a history
it has no weight. It is a number because GPUs may drop NaN."""

AOVS = MethodSpec(
    name="aovs",
    source="Guo, Chen, Dong and Tong 2022: one weight for all channels of a pixel",
    inputs=("aovs", "depth", "motion", "jitter", "display_size", "weight"),
    history={"aovs": (1, CHANNELS, *DISPLAY)},
    image=(1, CHANNELS, *DISPLAY),
)
