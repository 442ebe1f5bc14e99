"""Definitions of the methods that extrapolate unshaded frames, and of the upscaler for such frames."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from supersampler.methods.classifier.spec import BASE
from supersampler.methods.registry import register
from supersampler.methods.spec import BETWEEN, EARLIER, PREVIOUS, RENDER, SHADED, MethodSpec, Number, Sigma

NEIGHBOURS = ((0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
"""Offsets (x, y) of the eight neighbours of a sample, nearest first."""
SKY_DEPTH = 1e-30
"""Depth of the sky before the logarithm, in place of 0."""
INVALID_DEPTH = 1e4
"""Guide value of an invalid depth, in standard deviations: far from all others."""
KEY_STEPS, MAX_KEY, KEY_INDICES = 16.0, 262143.0, 64.0
"""Layout of a sort key: steps per unit of cost, maximum number of steps, range of indices."""
MIN_LIGHT_WEIGHT = 1e-12
"""Minimum sum of the weights of samples that are not missing, relative to that of the most similar sample;
below it, the pixel is missing."""
RING_MARGIN = 1.0 - 1e-3
"""Factor of the least cost of a ring, where kernels leave it out as too far away: against rounding."""


@dataclass(frozen=True)
class GuidedWarpConfig:
    """Constants; docs/methods.md explains them."""

    strides: tuple[int, ...] = (1, 3, 5, 9)
    """Radii of the rings of eight samples around the nearest sample, pixels (equation 1)."""
    taps: int = 4
    """Number of samples that are averaged."""
    surface_sigma: Sigma = 0.03
    """Standard deviation of base colour and normal (equation 2)."""
    depth_sigma: Sigma = 0.05
    """Standard deviation of relative depth."""
    distance_sigma: Sigma = 1.0
    """Standard deviation of screen distance, pixels of the shaded frame (equation 2)."""
    least: Number = 0.02
    """Reflectance that is added to base colours before a division by them."""


@dataclass(frozen=True)
class FlowNetworkConfig:
    """Widths of the network of `guided-flow`."""

    levels: tuple[int, ...] = (32, 48, 64, 96)
    """Channels of the pyramid's levels. The first level has half the size of the inputs, each next level half
    the size of the previous one."""


@dataclass(frozen=True)
class GuidedFlowConfig:
    """Constants; docs/methods.md explains them."""

    network: FlowNetworkConfig = field(default_factory=FlowNetworkConfig)
    """Widths of the network."""
    warp: GuidedWarpConfig = field(default_factory=GuidedWarpConfig)
    """Constants of `guided-warp`."""
    max_motion: float = 64.0
    """Maximum motion of light, render pixels."""
    max_stops: float = 2.0
    """Maximum gain in stops; 0 disables the gain."""
    normal_sigma: float = 0.5
    """Standard deviation of normals: light only moves along similar surfaces."""
    depth_sigma: float = 0.1
    """Standard deviation of relative depth."""


def _kernels_support(config: Mapping[str, Any]) -> bool:
    """Return whether there are four taps, and up to seven ascending radii of at most 64 pixels."""
    strides = config.get("strides")
    return (
        config.get("taps") == 4
        and isinstance(strides, list)
        and 1 <= len(strides) <= 7
        and all(type(stride) is int and 1 <= stride <= 64 for stride in strides)
        and strides == sorted(strides)
    )


GUIDED_WARP = register(
    MethodSpec(
        name="guided-warp",
        source="Wu et al. 2023 (ExtraSS), section 4.2",
        inputs=("depth", "motion", "jitter", "pre_exposure", "gbuffer_base_color", "gbuffer_normal"),
        history={
            "color": (1, 3, *SHADED),  # of the last shaded frame, like the next four
            "base_color": (1, 3, *SHADED),
            "normal": (1, 3, *SHADED),
            "depth": (1, 1, *SHADED),
            "jitter": (1, 2),
            "motion": (1, 2, *PREVIOUS),  # from the previous frame back to the shaded one, in its pixels
            "motion_jitter": (1, 2),  # of the previous frame
        },
        image=(1, 3, *RENDER),
        ratios=(1.0, 1.0),
        config=GuidedWarpConfig,
        torch="supersampler_model.methods.guided_warp:GuidedWarp",
        cpu="guided-warp",
        gpu="supersampler.methods.extrapolation.gpu:warp_shaders",
        kernels_support=_kernels_support,
    )
)
GUIDED_FLOW = register(
    replace(
        GUIDED_WARP,
        name="guided-flow",
        source="Wu et al. 2023 (ExtraSS), section 4.3 (docs/methods.md)",
        inputs=(*GUIDED_WARP.inputs, "gbuffer_roughness"),
        history={
            **GUIDED_WARP.history,
            "shaded_motion": (1, 2, *SHADED),  # of the last shaded frame
            "earlier_color": (1, 3, *EARLIER),  # of the shaded frame before it, like the next four
            "earlier_base_color": (1, 3, *EARLIER),
            "earlier_normal": (1, 3, *EARLIER),
            "earlier_depth": (1, 1, *EARLIER),
            "earlier_jitter": (1, 2),
            "earlier_motion": (1, 2, *BETWEEN),  # from the frame before the last shaded one back to that one
            "earlier_motion_jitter": (1, 2),  # of the frame before the last shaded one
        },
        config=GuidedFlowConfig,
        torch="supersampler_model.methods.guided_flow:GuidedFlow",
        task="supersampler_model.training.flow_task:FlowTask",
        weights="guided-flow.safetensors",
        cpu="",
        gpu="",
    )
)
EXTRAPOLATE = register(
    replace(
        BASE,
        name="extrapolate",
        source="Wu et al. 2023, section 4.4, on Guo, Chen, Dong and Tong 2022 (docs/methods.md)",
        torch="supersampler_model.methods.extrapolate:Extrapolate",
        task="supersampler_model.training.classifier_tasks:ExtrapolateTask",
        weights="extrapolate.safetensors",
    )
)
EXTRAPOLATE_UNSHADED = replace(
    EXTRAPOLATE,
    name="extrapolate-unshaded",
    inputs=(*EXTRAPOLATE.inputs, "gbuffer_base_color"),
    only_extrapolated=True,
)
