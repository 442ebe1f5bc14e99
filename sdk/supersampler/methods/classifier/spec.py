"""What `classifier` and its relatives are: a small network says how history and frame are weighed."""

from dataclasses import dataclass, field, replace
from typing import Literal

from supersampler.methods.spec import DISPLAY, HALF, PREVIOUS, MapOf, MethodSpec, Number, Sigma

CLASSES = 6
"""Of a pixel. Ghosting: none, visibility, shading; aliasing: none, geometry, texture."""
INPUTS = (
    "frame",  # luma of this frame, smoothly upsampled
    "sample",  # luma of the nearest samples
    "past",  # luma of the warped history
    "past_to_sample",  # the channel that differs most
    "past_to_frame",
    "contrast",  # of the samples around
    "past_contrast",  # of the warped history in 3x3 pixels
    "beyond",  # how far the sample is outside of the history in 3x3 pixels
    "least",  # luma that the samples of the history had
    "most",
    "detail",  # what the cubic has sharpened
    "confidence",  # how near the samples are
    "count",  # how many the history is made of
    "difference",  # of depth, equation 10
    "surface",  # whether the history shows what is there now
    "speed",
    "blur",  # of this resampling
    "edge",  # in depth
)
"""Names of what the network may see of a pixel, (1, 1, H, W) each."""
SEEN = tuple(name for name in INPUTS if name not in ("speed", "blur"))
"""Those that it does see: sixteen, which are one vector of bytes for four pixels (docs/methods.md)."""
AROUND = (
    "drift",  # mean difference of history and frame: their light differs
    "grain",  # mean absolute difference: they differ in detail alone, too
)
"""Names of what it may see of a neighbourhood of about ten pixels, (1, 1, H / 2, W / 2) each."""
CountCode = Literal["saturating", "logarithm"]
ToneSpace = Literal["largest", "channels", "logarithm"]


@dataclass(frozen=True)
class NetworkConfig:
    """Widths of the network."""

    levels: tuple[int, ...] = (32, 48, 96, 192)
    """Channels of the encoder's levels, each a multiple of what its pixels unpack into."""
    decoder: int = 32
    """Channels of the decoder."""
    decoder_layers: int = 1
    """Layers of the decoder."""
    hidden: int = 51
    """Channels of the compositor."""


@dataclass(frozen=True)
class ClassifierConfig:
    """Constants of the step around the network; docs/methods.md has what each gives."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Widths of the network."""
    inputs: tuple[str, ...] = SEEN
    """Those of INPUTS that the network sees."""
    around: tuple[str, ...] = AROUND
    """Those of AROUND that it sees."""
    count_code: CountCode = "saturating"
    """How it sees the count of samples."""
    recurrent: bool = True
    """Whether it also sees the classes of the previous frame."""
    rectified: bool = True
    """Whether the history cut to the box is one of the colours that are weighed."""
    own_motion: bool = True
    """Whether the history by each pixel's own motion is one, too; else that of the closest surface alone."""
    corrected: bool = True
    """Whether the warped history is filtered by a learned cross of five pixels."""
    tone_space: ToneSpace = "largest"
    """Tone curve under which colours are weighed."""
    sample_sigma: Sigma = 0.47
    """Gaussian of a sample's influence, display pixels."""
    moment_sigma: Sigma = 0.45
    """Gaussian window of the moments of the box, render pixels."""
    kernel_sigma: Sigma = 0.45
    """Gaussian that the learned kernel begins as, render pixels."""
    gamma: Number = 1.0
    """Half size of the box in standard deviations."""
    history_sharpness: Number = 0.7
    """-a of the cubic that resamples the history; 0.5 is Catmull-Rom."""
    samples: Number = 64.0
    """Most samples that the count counts."""
    contraction: Number = 1.0 / 16.0
    """Share by which the range of the history contracts to a new sample."""
    depth_margin: Number = 0.005
    """Relative depth by which the history must be closer before it counts as another surface."""
    depth_ramp: Number = 0.05
    """Relative depth over which that becomes certain."""

    @property
    def planes(self) -> int:
        """Channels of a pixel that the network sees."""
        return len(self.inputs)

    @property
    def carried(self) -> int:
        """Channels at half size that it sees."""
        return CLASSES * self.recurrent + len(self.around)

    @property
    def candidates(self) -> int:
        """Colours that are weighed."""
        return 4 + self.rectified + self.own_motion

    @property
    def filters(self) -> tuple[int, int, int]:
        """Outputs beside weights: sharpness, cross of the history, 3x3 kernel of this frame."""
        return 1, 4 * self.corrected, 9

    @property
    def mixing(self) -> int:
        """Outputs of the compositor for each pixel."""
        return self.candidates + sum(self.filters)


@dataclass(frozen=True)
class SmallConfig(ClassifierConfig):
    """Half the width, and without the parts that take time and of which a trained network has little."""

    network: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(levels=(16, 32, 64, 128), decoder=16, hidden=26)
    )
    rectified: bool = False
    own_motion: bool = False
    corrected: bool = False


@dataclass(frozen=True)
class PaperConfig(ClassifierConfig):
    """Widths as in section 1 of the supplement."""

    network: NetworkConfig = field(
        default_factory=lambda: NetworkConfig(levels=(32, 64, 128, 256), decoder_layers=3, hidden=64)
    )


CLASSIFIER = MethodSpec(
    name="classifier",
    source="Guo, Chen, Dong and Tong 2022 (docs/methods.md)",
    inputs=("color", "depth", "motion", "jitter", "exposure", "display_size"),
    history={
        "color": (1, 3, *DISPLAY),  # linear RGB
        "state": (1, 3, *DISPLAY),  # count, least and most luma, the latter and GLARE
        "classes": (1, CLASSES, *HALF),  # class probabilities
        "depth": (1, 2, *PREVIOUS),  # as it is, and without thin things
        "jitter": (1, 2),
        "exposure": (1,),  # as `followed_exposure` returns it; 0 where there is none
    },
    aux_outputs=("weight",),
    maps={
        "class_map": MapOf("next.classes", 0, CLASSES),
        "weight": MapOf("weight", 0, 1),
        "count": MapOf("next.state", 0, 1),
    },
    ratios=(1.0, 3.0),
    config=ClassifierConfig,
)
CLASSIFIER_SMALL = replace(CLASSIFIER, name="classifier-small", config=SmallConfig)
CLASSIFIER_PAPER = replace(
    CLASSIFIER,
    name="classifier-paper",
    source="Guo, Chen, Dong and Tong 2022, supplement",
    history={
        **CLASSIFIER.history,
        "state": (1, 7, *DISPLAY),  # counter, least and most colour
        "classes": (1, CLASSES, *DISPLAY),
    },
    config=PaperConfig,
)
