"""Definition of `gbuffer-fast`: `classifier` on lighting that display-size G-buffers guide."""

from dataclasses import dataclass

from supersampler.methods.at_rest import AT_REST_HISTORY
from supersampler.methods.classifier.spec import BASE, CLASSIFIER, DEFAULT_INPUTS, ClassifierConfig
from supersampler.methods.registry import register
from supersampler.methods.spec import DISPLAY, Flag, MethodSpec, Number, Sigma, UnitFloat

_REPLACED = {
    "min_luma": "relit_to_frame",  # largest channel difference of the relit history and this frame
    "max_luma": "agreement",  # similarity of the nearby samples' surfaces to the pixel's own
}
GUIDED_INPUTS = tuple(_REPLACED.get(name, name) for name in DEFAULT_INPUTS)
"""Network inputs per pixel: the inputs of `classifier`, two of them replaced. `frame` is the guided colour,
and `edge` comes from depth in 3x3 display pixels."""
GBUFFERS_READ = (
    "gbuffer_base_color",
    "gbuffer_normal",
    "gbuffer_display_base_color",
    "gbuffer_display_normal",
    "gbuffer_display_depth",
)

MIN_SIMILARITY = 1e-4
"""Added to the weights of samples by distance and by surface, so that every pixel has samples with weight."""
MAX_DEPTH_COST = 10.0
"""Limit of the exponent of a difference in depth; half floats hold its exponential."""


@dataclass(frozen=True)
class GuidedConfig(ClassifierConfig):
    """Constants of the step; docs/methods.md describes the effect of each."""

    inputs: tuple[str, ...] = GUIDED_INPUTS
    rectified: Flag = False
    guide_sigma: Sigma = 0.5
    """Gaussian of a sample's weight by distance, render pixels."""
    depth_sigma: Sigma = 0.03
    """Gaussian of a sample's weight by the relative difference of depth."""
    normal_falloff: Number = 4.0
    """A sample's weight is exp(-falloff * squared difference of normals)."""
    base_color_falloff: Number = 8.0
    """A sample's weight is exp(-falloff * squared difference of base colours)."""
    min_reflectance: UnitFloat = 0.08
    """Reflectance of black surfaces, about twice a dielectric's. White surfaces reflect 1."""


GBUFFER_FAST = register(
    MethodSpec(
        name="gbuffer-fast",
        source="Guo et al. 2022, on light resampled as by Wang et al. 2025 (docs/methods.md)",
        inputs=(*CLASSIFIER.inputs, *GBUFFERS_READ),
        history={**BASE.history, "reflectance": (1, 3, *DISPLAY), **AT_REST_HISTORY},
        aux_outputs=CLASSIFIER.aux_outputs,
        maps=CLASSIFIER.maps,
        ratios=(1.0, 4.0),
        config=GuidedConfig,
        torch="supersampler_model.methods.gbuffer_fast:GuidedClassifier",
        task="supersampler_model.training.classifier_tasks:GuidedTask",
        weights="gbuffer-fast.safetensors",
        cpu="gbuffer-fast",
        gpu="supersampler.methods.gbuffer_fast.gpu:guided_program",
        kernel_files=CLASSIFIER.kernel_files,
    )
)
