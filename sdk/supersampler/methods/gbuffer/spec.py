"""Definitions of `gbuffer` and related methods: supersampling with display-size G-buffers."""

from dataclasses import dataclass, field, replace
from typing import Literal

from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.registry import register
from supersampler.methods.spec import DISPLAY, FRAME_INPUTS, PREVIOUS, MethodSpec

FRAME = 11
"""Channels of a stored frame: linear RGB, depth, base colour, normal, 1 if valid."""
NEIGHBOUR_WEIGHTS = (0.03, 0.12, 0.03, 0.12, 1.0, 0.12, 0.03, 0.12, 0.03)
"""Initial weights of 3x3 pixels, which a learned kernel multiplies."""
STEP_COST = 0.002
"""Cost of a sample per squared step of distance, as a relative difference of depth."""
Attention = Literal["both", "one", "none"]


@dataclass(frozen=True)
class GBufferNetworkConfig:
    """Widths, and the parts in the paper's ablation (table IX)."""

    surfaces: tuple[int, ...] = (128, 128, 64)
    """Channels of each layer of the G-buffer encoder."""
    detailed: tuple[int, ...] = (64, 64, 64)
    """Channels of each layer of its gated branch; the last width must equal that of `surfaces`."""
    frame: int = 32
    """Channels of the frame encoder."""
    levels: tuple[int, ...] = (64, 128, 192, 256)
    """Channels of the fusion network, finest first."""
    separable: bool = False
    """Whether 3x3 convolutions are depthwise, between 1x1 convolutions."""
    gated: bool = True
    """Whether base colour and depth have a gated branch."""
    attention: Attention = "both"
    """Cross-attention of the frame and the gradients of the G-buffers: both ways, one way, or none."""
    refined: bool = True
    """Whether features of previous frames pass through a refiner network."""


SMALL_NETWORK = GBufferNetworkConfig(
    surfaces=(32, 32), detailed=(32, 32), frame=24, levels=(48, 64, 96, 128), separable=True
)


@dataclass(frozen=True)
class GBufferConfig:
    """Constants; docs/methods.md describes the effect of each."""

    network: GBufferNetworkConfig = field(default_factory=GBufferNetworkConfig)
    """Widths of the network."""
    ratio: int = 2
    """Display over render size."""
    history_sharpness: float = 0.6
    """-a of the cubic that resamples the history; 0.5 is Catmull-Rom."""
    samples: float = 64.0
    """Maximum of the sample count."""
    sample_sigma: float = 0.47
    """Gaussian of a sample's weight, display pixels."""
    smooth_sigma: float = 0.45
    """Gaussian of the mean that weighs samples by distance alone, render pixels."""
    depth_margin: float = 0.01
    """Relative depth by which the history must be closer before disocclusion begins."""
    depth_ramp: float = 0.05
    """Further relative depth at which disocclusion is complete."""
    masked: bool = True
    """Whether the previous frames are masked by equations 1 and 2."""
    blended: bool = True
    """Whether the previous image is blended in per pixel, the paper's future work (section V). Otherwise the
    history only enters as network features."""

    @property
    def parts(self) -> tuple[int, int, int]:
        """Numbers of blend parameters: weights of colours, kernel on neighbours, kernel on samples."""
        return 7, 9, 9


@dataclass(frozen=True)
class GBuffer4Config(GBufferConfig):
    """`GBufferConfig` at a ratio of 4."""

    ratio: int = 4


@dataclass(frozen=True)
class SmallGBufferConfig(GBufferConfig):
    """`GBufferConfig` with narrow, separable convolutions."""

    network: GBufferNetworkConfig = field(default_factory=lambda: SMALL_NETWORK)


@dataclass(frozen=True)
class SmallGBuffer4Config(SmallGBufferConfig):
    """`SmallGBufferConfig` at a ratio of 4."""

    ratio: int = 4


GBUFFER = register(
    MethodSpec(
        name="gbuffer",
        source="Wang et al. 2025 (docs/methods.md)",
        inputs=(*FRAME_INPUTS, *GBUFFERS),
        history={
            "color": (1, 3, *DISPLAY),  # linear RGB
            "reflectance": (1, 3, *DISPLAY),
            "count": (1, 1, *DISPLAY),
            "frame": (1, FRAME, *PREVIOUS),
            "frame_before": (1, FRAME, *PREVIOUS),
            "motion": (1, 2, *PREVIOUS),
            "jitter": (1, 2),
            "jitter_before": (1, 2),
            "exposure": (1,),  # see `followed_exposure`; 0: none yet
        },
        aux_outputs=("weight",),
        ratios=(2.0, 2.0),
        config=GBufferConfig,
        torch="supersampler_model.methods.gbuffer:GBuffer",
        task="supersampler_model.training.gbuffer_task:GBufferTask",
    )
)
GBUFFER_4X = register(
    replace(
        GBUFFER,
        name="gbuffer-4x",
        ratios=(4.0, 4.0),
        config=GBuffer4Config,
        torch="supersampler_model.methods.gbuffer:GBuffer4",
    )
)
GBUFFER_SMALL = register(
    replace(
        GBUFFER,
        name="gbuffer-small",
        config=SmallGBufferConfig,
        torch="supersampler_model.methods.gbuffer:SmallGBuffer",
        weights="gbuffer-small.safetensors",
    )
)
GBUFFER_SMALL_4X = register(
    replace(
        GBUFFER_SMALL,
        name="gbuffer-small-4x",
        ratios=(4.0, 4.0),
        config=SmallGBuffer4Config,
        torch="supersampler_model.methods.gbuffer:SmallGBuffer4",
        weights="gbuffer-small-4x.safetensors",
    )
)
