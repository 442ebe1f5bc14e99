"""Definition of `aovs`, the step that blends a frame's AOVs with the weights of the colour."""

from supersampler.methods.spec import CHANNELS, DISPLAY, MethodSpec

AOVS = MethodSpec(
    name="aovs",
    source="Guo, Chen, Dong and Tong 2022: one weight for all channels of a pixel",
    inputs=("aovs", "depth", "motion", "jitter", "display_size", "weight"),
    history={"aovs": (1, CHANNELS, *DISPLAY)},
    image=(1, CHANNELS, *DISPLAY),
)
