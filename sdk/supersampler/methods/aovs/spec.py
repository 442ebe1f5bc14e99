"""Definition of `aovs`, the step that blends a frame's AOVs by the weight that blended the colour."""

from supersampler.methods.spec import CHANNELS, DISPLAY, MethodSpec

AOVS = MethodSpec(
    name="aovs",
    source="Guo, Chen, Dong and Tong 2022: one weight for all that a pixel has",
    inputs=("aovs", "depth", "motion", "jitter", "display_size", "weight"),
    history={"aovs": (1, CHANNELS, *DISPLAY)},
    image=(1, CHANNELS, *DISPLAY),
)
