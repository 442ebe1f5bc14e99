"""Definitions of `classifier` and related methods: a network predicts how history and frame are blended."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Self

from supersampler.methods import spec as shapes
from supersampler.methods.at_rest import ADDS_SAMPLES, AT_REST_HISTORY, CONVERGED
from supersampler.methods.registry import register

CLASSES = 6
"""Class probabilities of a pixel. Ghosting: none, visibility, shading; aliasing: none, geometry, texture."""
INPUTS = (
    "frame",  # luma of this frame, upsampled
    "sample",  # luma of the samples near the pixel
    "history",  # luma of the warped history
    "history_to_sample",  # largest difference of a channel
    "history_to_frame",
    "contrast",  # standard deviation of the surrounding samples
    "history_contrast",  # luma range of the warped history in 3x3 pixels
    "beyond_range",  # distance of the sample's luma from that range
    "min_luma",  # minimum luma of the accumulated samples
    "max_luma",  # maximum luma of the accumulated samples
    "detail",  # cubic minus bilinear resampling of the history
    "confidence",  # sum of Gaussian weights of the samples near the pixel
    "count",  # number of accumulated samples
    "depth_difference",  # relative difference of depth, equation 10
    "surface",  # 0 where disoccluded
    "speed",  # length of the motion
    "blur",  # blur by resampling of the history
    "edge",  # relative range of depth in 3x3 samples
)
"""Available network inputs per display pixel, (1, 1, H, W) each."""

DEFAULT_INPUTS = tuple(name for name in INPUTS if name not in ("speed", "blur"))
"""The sixteen default inputs; the inputs of four pixels fill one vector of bytes (docs/methods.md)."""

NEIGHBOURHOOD_INPUTS = (
    "mean_difference",  # absolute mean difference of history and frame: the lighting changed
    "mean_abs_difference",  # mean absolute difference: also of detail alone
)
"""Inputs per neighbourhood of about ten display pixels, (1, 1, H / 2, W / 2) each."""

CountCode = Literal["saturating", "logarithm"]
ToneSpace = Literal["largest", "channels", "logarithm"]

WHITE, RISE, CONTRAST, FLASH_FRACTION = 0.5, 0.2, 0.1, 1.0 / 64.0
"""The light of a pixel is unconfirmed if its toned luma exceeds WHITE, and exceeds all samples of the history
by RISE. This applies only if more than FLASH_FRACTION of the image are such pixels that also exceed their
neighbourhood by CONTRAST, which excludes areas that a moving object disoccludes."""

MAX_LOG_FACTOR = 16.0
"""Limit of the absolute logarithm of a learned factor of a weight."""
MAX_SHARPNESS = 2.0
"""Maximum factor of the detail that is added to the history."""
FRAME_PRIOR = 0.05
"""Initial weight of the upsampled frame, and of the samples under the learned kernel."""
OTHER_PRIOR = 0.1
"""Initial weight of the other history colours, relative to the warped history's."""
MIN_PRIOR = 1e-3
"""Added to the initial weights of all other colours."""
HALF_COUNT = 4.0
"""Sample count that the network input "count" encodes as 1/2. Also the reciprocal of the fraction of the
history's samples that must be kept for its luma range to be kept unchanged."""


@dataclass(frozen=True)
class NetworkConfig:
    """Widths of the network."""

    levels: tuple[int, ...] = (32, 48, 96, 192)
    """Channels of the encoder's levels, each a multiple of 4^level."""
    decoder: int = 32
    """Channels of the decoder."""
    decoder_layers: int = 1
    """Number of 1x1 convolutions in the decoder."""
    hidden: int = 51
    """Channels of the compositor's hidden layer."""


class Variant(NamedTuple):
    """Compile-time variant of kernels and shaders, and the indices of blend parameters that follow from it.

    A pixel's blend parameters are the weights of the history colours and of three colours of this frame, the
    sharpness of the history, and a 3x3 kernel on this frame.
    """

    rectified: bool
    own_motion: bool

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> Self:
        """Return the variant of a model with this config."""
        return cls(config["rectified"], config["own_motion"])

    @property
    def colors(self) -> int:
        """Number of blended colours, whose weights come before the sharpness and the kernel."""
        return 4 + self.rectified + self.own_motion

    @property
    def blend_parameters(self) -> int:
        """Number of blend parameters of a display pixel."""
        return self.colors + 1 + 9

    @property
    def outputs(self) -> int:
        """Outputs of the last layer: `blend_parameters` of four pixels, up to a multiple of eight."""
        return -(-4 * self.blend_parameters // 8) * 8


@dataclass(frozen=True)
class ClassifierConfig:
    """Constants of the step; docs/methods.md describes the effect of each."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Widths of the network."""
    inputs: tuple[str, ...] = DEFAULT_INPUTS
    """Network inputs per pixel, names of INPUTS."""
    neighbourhood_inputs: tuple[str, ...] = NEIGHBOURHOOD_INPUTS
    """Network inputs per neighbourhood, names of NEIGHBOURHOOD_INPUTS."""
    count_code: CountCode = "saturating"
    """Encoding of the sample count."""
    recurrent: bool = True
    """Whether the classes of the previous frame are network inputs."""
    rectified: shapes.Flag = True
    """Whether the clipped history is one of the blended colours."""
    own_motion: shapes.Flag = True
    """Whether the history warped by undilated motion is one of the blended colours."""
    tone_space: ToneSpace = "largest"
    """Tone curve of the blended colours."""
    sample_sigma: shapes.Sigma = 0.47
    """Gaussian of a sample's weight, display pixels."""
    moment_sigma: shapes.Sigma = 0.45
    """Gaussian window of the moments of the variance box, render pixels."""
    kernel_sigma: shapes.Sigma = 0.45
    """Gaussian that the learned kernel multiplies, render pixels."""
    gamma: shapes.Number = 1.0
    """Half size of the box in standard deviations."""
    history_sharpness: shapes.Number = 0.7
    """-a of the cubic that resamples the history; 0.5 is Catmull-Rom."""
    samples: shapes.Number = 64.0
    """Maximum of the sample count."""
    contraction: shapes.Number = 1.0 / 16.0
    """Fraction by which the luma range contracts towards each new sample."""
    depth_margin: shapes.Number = 0.005
    """Relative depth by which the history must be closer before disocclusion begins."""
    depth_ramp: shapes.Number = 0.05
    """Further relative depth at which disocclusion is complete."""

    @property
    def planes(self) -> int:
        """Number of network inputs per display pixel."""
        return len(self.inputs)

    @property
    def half_inputs(self) -> int:
        """Number of network inputs at half display size."""
        return CLASSES * self.recurrent + len(self.neighbourhood_inputs)

    @property
    def candidates(self) -> int:
        """Number of blended colours."""
        return Variant(self.rectified, self.own_motion).colors

    @property
    def filters(self) -> tuple[int, int]:
        """Numbers of other blend parameters: sharpness of the history, 3x3 kernel on this frame."""
        return 1, 9

    @property
    def blend_parameters(self) -> int:
        """Number of blend parameters per display pixel."""
        return self.candidates + sum(self.filters)


@dataclass(frozen=True)
class SmallConfig(ClassifierConfig):
    """About half the width, without the clipped history and the undilated motion."""

    network: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(levels=(16, 32, 64, 128), decoder=16, hidden=26)
    )
    rectified: shapes.Flag = False
    own_motion: shapes.Flag = False


@dataclass(frozen=True)
class PaperConfig(ClassifierConfig):
    """Widths as in section 1 of the supplement."""

    network: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(levels=(32, 64, 128, 256), decoder_layers=3, hidden=64)
    )


BASE = shapes.MethodSpec(
    name="classifier",
    source="Guo, Chen, Dong and Tong 2022 (docs/methods.md)",
    inputs=shapes.FRAME_INPUTS,
    history={
        "color": (1, 3, *shapes.DISPLAY),  # linear RGB
        "state": (1, 3, *shapes.DISPLAY),  # count, minimum luma, maximum luma + GLARE * glaring frames
        "classes": (1, CLASSES, *shapes.HALF),  # class probabilities
        "depth": (1, 2, *shapes.PREVIOUS),  # depth, and occluding depth
        "jitter": (1, 2),
        "exposure": (1,),  # see `followed_exposure`; 0: none yet
    },
    aux_outputs=("weight",),
    maps={
        "class_map": shapes.MapOf("next.classes", 0, CLASSES),
        "weight": shapes.MapOf("weight", 0, 1),
        "count": shapes.MapOf("next.state", 0, 1),
    },
    ratios=(1.0, 3.0),
    config=ClassifierConfig,
)
"""Common fields of all methods with a classifier."""
CLASSIFIER = register(
    replace(
        BASE,
        inputs=(*BASE.inputs, ADDS_SAMPLES),
        history={**BASE.history, **AT_REST_HISTORY},
        aux_outputs=(*BASE.aux_outputs, "converged"),
        maps={**BASE.maps, **CONVERGED},
        torch="supersampler_model.methods.classifier:Classifier",
        task="supersampler_model.training.classifier_tasks:ClassifierTask",
        weights="classifier.safetensors",
        cpu="classifier",
        gpu="supersampler.methods.classifier.gpu:classifier_program",
        kernel_files=("network.npz",),
    )
)
CLASSIFIER_SMALL = register(
    replace(
        CLASSIFIER,
        name="classifier-small",
        config=SmallConfig,
        torch="supersampler_model.methods.classifier:SmallClassifier",
        weights="classifier-small.safetensors",
    )
)
CLASSIFIER_PAPER = register(
    replace(
        BASE,
        name="classifier-paper",
        source="Guo, Chen, Dong and Tong 2022, supplement",
        history={
            **BASE.history,
            "state": (1, 7, *shapes.DISPLAY),  # counter, minimum and maximum colour
            "classes": (1, CLASSES, *shapes.DISPLAY),
        },
        config=PaperConfig,
        torch="supersampler_model.methods.classifier_paper:PaperClassifier",
        task="supersampler_model.training.classifier_tasks:ClassifierTask",
    )
)
