"""Shaders of `guided-warp`."""

from supersampler.backends.gpu.extrapolation import WarpShaders
from supersampler.backends.gpu.program import ARRAYS
from supersampler.backends.gpu.shader import load_shader
from supersampler.methods.extrapolation.spec import GUIDED_WARP, NEIGHBOURS
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of


def warp_shaders(info: ModelInfo) -> WarpShaders:
    """Return the shaders of a `guided-warp` model."""
    strides = info.config["strides"]
    rings = [(stride * x, stride * y) for stride in strides for x, y in NEIGHBOURS]
    constants = {name: info.config[name] for name in constants_of(GUIDED_WARP)} | {"rings": len(strides)}
    packages = ("supersampler.methods.extrapolation",)
    read_shaded, warp = (load_shader(name, packages, constants, ARRAYS) for name in ("read_shaded", "warp"))
    return WarpShaders(read_shaded, warp, offsets=((0, 0), *rings))
