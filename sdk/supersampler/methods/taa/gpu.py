"""Shaders of `taa`."""

from supersampler.backends.gpu.history import PIXELS, HistoryLayout, of_plane
from supersampler.backends.gpu.program import GpuProgram, PassSpec
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taa.spec import TAA

LAYOUT = HistoryLayout(TAA, {"pixels": PIXELS}, {"color": of_plane("pixels", 0, 1, 2)})


def taa_program(info: ModelInfo) -> GpuProgram:
    """Return the GPU program of a `taa` model."""
    return GpuProgram(
        LAYOUT,
        ("supersampler.methods.taa",),
        {name: info.config[name] for name in constants_of(TAA)},
        (PassSpec("blend"),),
        {},
    )
