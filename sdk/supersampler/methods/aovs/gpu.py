"""The shader of `aovs`."""

from supersampler.backends.gpu.program import ARRAYS, PassSpec
from supersampler.backends.gpu.shader import Shader, load_shader


def aov_pass(channels: int, *, has_history: bool) -> PassSpec:
    """Return the pass that blends AOVs of so many channels, with or without an AOV history."""
    history = "aov_history" if has_history else "no_aov_history"
    return PassSpec("blend_aovs", constants={"channels": channels}, variants={"aov_history": history})


def aov_shader(spec: PassSpec) -> Shader:
    """Return the shader of such a pass, for frames in buffers."""
    packages = ("supersampler.methods.aovs",)
    return load_shader(spec.shader, packages, spec.constants, {**ARRAYS, **spec.variants})
