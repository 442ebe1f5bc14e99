"""Definition of `taau`: temporal upsampling without a network."""

from dataclasses import dataclass

from supersampler.methods.at_rest import ADDS_SAMPLES, AT_REST_HISTORY, CONVERGED
from supersampler.methods.registry import register
from supersampler.methods.spec import DISPLAY, FRAME_INPUTS, PREVIOUS, MapOf, MethodSpec, Number, Sigma

FLASH, LEAST_FLASH, FLASH_MEMORY = 1.25, 1e-3, 0.9
"""The light of a frame is unconfirmed if its mean local variance exceeds FLASH times the previous frames'
plus LEAST_FLASH. The previous variance is a maximum that decays by FLASH_MEMORY per frame, because
extrapolated frames are smoother than the shaded frames that they alternate with."""
NO_CONTRAST = 1e-6
"""Mean local variance up to which a frame is of one colour, as a title card. What follows it is no flash."""

UNFIT, FIT = 0.8, 0.95
"""Fractions of the luma variance of 3x3 samples that a fitted plane explains: from UNFIT on they start to
count as a smooth surface, from FIT on they do so fully. A straight edge reaches at most 0.75."""

LAG_STEP, LEAST_BLOCKS, MOST_SAMPLES = 2, 0.125, 1024.0
"""Distance, along an axis, of samples that are compared for the lag; minimum fraction of a window's blocks
that must be comparable; number of samples that does not limit the history."""

ROUNDING = 0.501
"""Added to positions that are then rounded down: all backends round up those half way between two pixels,
which a jitter of 1/6 yields at a ratio of 1.5."""
MIN_SAMPLES = 1e-3
"""Number of samples below which the history is not used."""
MIN_WINDOW_WEIGHT = 0.5
"""Minimum fraction of valid samples in the windows of the variance box and of the change of light."""


@dataclass(frozen=True)
class TaauConfig:
    """Constants, tuned with `supersampler bench quality` and the analytic scenes of the tests."""

    sample_sigma: Sigma = 0.47
    """Gaussian of a sample's weight in the accumulated colour, display pixels."""
    history_sharpness: Number = 0.7
    """-a of the cubic that resamples the history; 0.5 is Catmull-Rom."""
    moment_sigma: Sigma = 0.4
    """Gaussian window of the moments of the variance box, render pixels."""
    gamma_still: Number = 1.3
    """Half size of the box in standard deviations, at rest."""
    gamma_moving: Number = 0.8
    """Half size of the box at speeds of `gamma_speed` and above."""
    gamma_speed: Number = 10.0
    """Speed at which `gamma_moving` is reached, display pixels per frame."""
    gamma_time: Number = 1.6
    """Half size of the box in standard deviations over time."""
    spread_samples: Number = 14.0
    """Samples over which the deviation over time is averaged."""
    spread_step: Number = 0.15
    """The deviation of a sample is limited to the average so far plus this: thin wires build it up over some
    frames, one firefly does not."""
    forget: Number = 0.5
    """Fraction of the samples that is dropped per half size of the box, by distance to the box."""
    samples: Number = 18.0
    """Maximum of the sample count: samples / (1 + blur_cost * blur^2 + speed_cost * speed)."""
    blur_cost: Number = 48.0
    """Reduction of that maximum by a full resampling blur. The blur of a cubic grows with the square of small
    offsets, so that a slow camera keeps more samples."""
    speed_cost: Number = 7.5
    """Reduction of that maximum per display pixel of motion."""
    settled: Number = 0.9
    """Sample count from which on only samples near the centre are added, not the upsampled frame."""
    depth_margin: Number = 0.005
    """Relative depth by which the history must be closer before disocclusion begins."""
    depth_ramp: Number = 0.05
    """Further relative depth at which disocclusion is complete."""
    change_deviation: Number = 0.28
    """The light has changed if the mean difference of samples and history, in toned luma, is more than this
    many standard deviations ..."""
    least_change: Number = 0.004
    """... plus this; the change is complete at twice that. If an eighth of a window changes, as at the edge
    of a shadow, the mean is 0.38 deviations; in steady light, 18 independent samples have one of 0.24."""
    change_spread: Number = 6.0
    """Weight of the mean square difference of earlier frames, which is added to the variance."""
    lag: Number = 0.015
    """Tolerated mean difference of a window's samples from the history, relative to the history ..."""
    lag_deviations: Number = 3.0
    """... plus this many standard errors."""
    lag_samples: Number = 0.014
    """Number of samples that are kept at an excess of 1 over that; inversely proportional to the excess."""


TAAU = register(
    MethodSpec(
        name="taau",
        source="temporal upsampling after Karis 2014, Salvi 2016 and FSR2 (docs/methods.md)",
        inputs=(*FRAME_INPUTS, ADDS_SAMPLES),
        history={
            "color": (1, 3, *DISPLAY),  # linear RGB
            "samples": (1, 2, *DISPLAY),  # count; mean square of sample - history in toned luma, plus GLARE
            "surface": (1, 1, *PREVIOUS),  # occluding depth
            "jitter": (1, 2),  # of `surface`
            "exposure": (1,),  # see `followed_exposure`; 0: none yet
            "light": (1, 4),  # mean luma, mean local variance, previous frames' variance, successive flashes
            **AT_REST_HISTORY,
        },
        aux_outputs=("weight", "converged"),
        maps={"weight": MapOf("weight", 0, 1), "count": MapOf("next.samples", 0, 1), **CONVERGED},
        config=TaauConfig,
        torch="supersampler_model.methods.taau:Taau",
        cpu="taau",
        gpu="supersampler.methods.taau.gpu:taau_program",
    )
)
