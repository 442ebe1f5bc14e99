"""What the methods are that extrapolate unshaded frames, and the upscaler that steps on such frames."""

from dataclasses import dataclass, field, replace

from supersampler.methods.classifier.spec import CLASSIFIER
from supersampler.methods.spec import BETWEEN, EARLIER, PREVIOUS, RENDER, SHADED, MethodSpec, Number, Sigma


@dataclass(frozen=True)
class GuidedWarpConfig:
    """Constants; docs/methods.md has where they come from."""

    strides: tuple[int, ...] = (1, 3, 5, 9)
    """Of the rings of eight samples around the middle one, pixels (equation 1)."""
    taps: int = 4
    """Samples that are kept."""
    surface_sigma: Sigma = 0.03
    """One standard deviation of base colour and normal (equation 2)."""
    depth_sigma: Sigma = 0.05
    """One of depth, as a share of it."""
    distance_sigma: Sigma = 1.0
    """One of places on screen, pixels of the shaded frame (equation 2)."""
    least: Number = 0.02
    """Reflectance that is added to base colours, so that dividing by black ones changes nothing."""


@dataclass(frozen=True)
class FlowNetworkConfig:
    """Widths."""

    levels: tuple[int, ...] = (32, 48, 64, 96)
    """Channels of the pyramid's levels; each is half as large as the one before, the first half as large as
    the images."""


@dataclass(frozen=True)
class GuidedFlowConfig:
    """Constants; docs/methods.md has where they come from."""

    network: FlowNetworkConfig = field(default_factory=FlowNetworkConfig)
    """Widths of the network."""
    warp: GuidedWarpConfig = field(default_factory=GuidedWarpConfig)
    """Constants of `guided-warp`."""
    farthest: float = 64.0
    """How far light is moved at most, pixels of the render size."""
    stops: float = 2.0
    """By how much it is made brighter or darker at most; 0 leaves it to the flow alone."""
    turned: float = 0.5
    """Difference of two normals of one standard deviation: light is moved along a surface alone."""
    apart: float = 0.1
    """The same of two depths, as a share of one."""


GUIDED_WARP = MethodSpec(
    name="guided-warp",
    source="Wu et al. 2023 (ExtraSS), section 4.2",
    inputs=("depth", "motion", "jitter", "gbuffer_base_color", "gbuffer_normal"),
    history={
        "color": (1, 3, *SHADED),  # of the last shaded frame, as the next four
        "base_color": (1, 3, *SHADED),
        "normal": (1, 3, *SHADED),
        "depth": (1, 1, *SHADED),
        "jitter": (1, 2),
        "motion": (1, 2, *PREVIOUS),  # from the previous frame back to the shaded one, its own pixels
        "motion_jitter": (1, 2),  # of the previous frame
    },
    image=(1, 3, *RENDER),
    ratios=(1.0, 1.0),
    config=GuidedWarpConfig,
)
GUIDED_FLOW = replace(
    GUIDED_WARP,
    name="guided-flow",
    source="Wu et al. 2023 (ExtraSS), section 4.3 (docs/methods.md)",
    inputs=(*GUIDED_WARP.inputs, "gbuffer_roughness"),
    history={
        **GUIDED_WARP.history,
        "shaded_motion": (1, 2, *SHADED),  # of the last shaded frame
        "earlier_color": (1, 3, *EARLIER),  # of the shaded frame before it, as the next four
        "earlier_base_color": (1, 3, *EARLIER),
        "earlier_normal": (1, 3, *EARLIER),
        "earlier_depth": (1, 1, *EARLIER),
        "earlier_jitter": (1, 2),
        "earlier_motion": (1, 2, *BETWEEN),  # from the frame before the last shaded one back to that
        "earlier_motion_jitter": (1, 2),  # of the frame before the last shaded one
    },
    config=GuidedFlowConfig,
)
EXTRAPOLATE = replace(
    CLASSIFIER,
    name="extrapolate",
    source="Wu et al. 2023, section 4.4, on Guo, Chen, Dong and Tong 2022 (docs/methods.md)",
)
EXTRAPOLATE_UNSHADED = replace(
    EXTRAPOLATE,
    name="extrapolate-drawn",
    inputs=(*EXTRAPOLATE.inputs, "gbuffer_base_color"),
    only_extrapolated=True,
)
