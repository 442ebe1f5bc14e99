"""Shaders of `classifier-large`: the shaders of `classifier` on a larger display, and a filter."""

from collections.abc import Mapping
from dataclasses import replace

from supersampler.backends.gpu.history import HistoryLayout
from supersampler.backends.gpu.memory import LARGE, PixelTexture
from supersampler.backends.gpu.program import SHOWS_STATIC, GpuProgram, PassSpec
from supersampler.methods.classifier.gpu import LAYOUT, classifier_program
from supersampler.methods.classifier_large.spec import CLASSIFIER_LARGE, REACH
from supersampler.methods.model_info import ModelInfo

_VARIANTS: Mapping[str, str] = {"display": "display_large", "show": "show_large"}
"""Shader files that make the passes of `classifier` compute images of the larger display."""


def large_program(info: ModelInfo) -> GpuProgram:
    """Return the GPU program of a `classifier-large` model.

    Raises:
        ModelError: see `classifier_program`.
    """
    program = classifier_program(info)
    passes = [
        one._replace(extent=one.extent.enlarged, variants={**one.variants, **_VARIANTS})
        for one in program.method_passes
    ]
    frozen = "block_states", "history_mean", "next_mean", "image"
    downsample = PassSpec("downsample", constants={"taps": 2 * REACH}, static=SHOWS_STATIC, at_rest=frozen)
    memory = {name: m._replace(extent=m.extent.enlarged) for name, m in program.method_memory.items()}
    return replace(
        program,
        layout=HistoryLayout(CLASSIFIER_LARGE, LAYOUT.planes, LAYOUT.channels),
        packages=("supersampler.methods.classifier_large", *program.packages),
        method_passes=(*passes, downsample),
        method_memory={**memory, "large_image": PixelTexture(LARGE)},
    )
