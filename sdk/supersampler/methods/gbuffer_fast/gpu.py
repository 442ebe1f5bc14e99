"""Shaders of `gbuffer-fast`: the shaders of `classifier` on colours that G-buffers guide."""

from collections.abc import Mapping
from dataclasses import replace

from supersampler.backends.gpu.history import BYTES, HistoryLayout, HistoryPlane, of_plane
from supersampler.backends.gpu.memory import DISPLAY, PixelTexture
from supersampler.backends.gpu.program import GpuProgram
from supersampler.methods.classifier.gpu import LAYOUT as CLASSIFIER_LAYOUT
from supersampler.methods.classifier.gpu import classifier_program
from supersampler.methods.gbuffer.spec import NEIGHBOUR_WEIGHTS, STEP_COST
from supersampler.methods.gbuffer_fast.spec import GBUFFER_FAST
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of

_VARIANTS: Mapping[str, str] = {"pixel_surface": "guided_surface", "frame_colors": "guided_colors"}
"""Shader files that replace those of `classifier`."""


LAYOUT = HistoryLayout(
    GBUFFER_FAST,
    {**CLASSIFIER_LAYOUT.planes, "reflectance": HistoryPlane("reflectance", 1, "r32uint", BYTES)},
    {**CLASSIFIER_LAYOUT.channels, "reflectance": of_plane("reflectance", 0, 1, 2)},
)


def guided_program(info: ModelInfo) -> GpuProgram:
    """Return the GPU program of a `gbuffer-fast` model.

    Raises:
        ModelError: see `classifier_program`.
    """
    program = classifier_program(info)
    corner, side, _, _, center, *_ = NEIGHBOUR_WEIGHTS
    return replace(
        program,
        layout=LAYOUT,
        packages=("supersampler.methods.gbuffer_fast", *program.packages),
        constants={
            **program.constants,
            **{name: info.config[name] for name in constants_of(GBUFFER_FAST)},
            "step_cost": STEP_COST,
            "neighbour_corner": corner,
            "neighbour_side": side,
            "neighbour_center": center,
        },
        method_passes=[one._replace(variants={**one.variants, **_VARIANTS}) for one in program.method_passes],
        method_memory={**program.method_memory, "guided": PixelTexture(DISPLAY, "rgba32uint")},
    )
