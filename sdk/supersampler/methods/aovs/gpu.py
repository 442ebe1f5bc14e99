"""The shader of `aovs`."""

from collections.abc import Mapping

from supersampler.backends.gpu.program import PassSpec
from supersampler.backends.gpu.shader import Shader, load_shader


def aov_pass(parts: int, first: int = 0, *, in_texture: bool, has_history: bool) -> PassSpec:
    """Return a pass that blends AOVs, with or without an AOV history.

    Args:
        parts: values of a pixel of the history: channels; textures, if AOVs are in textures.
        first: index of the texture that the pass blends.
        in_texture: whether the AOVs are in textures; else the pass blends all channels of a buffer.
        has_history: whether there is a history.
    """
    variants = {
        "aov_history": "aov_history" if has_history else "no_aov_history",
        "aovs": "aov_textures" if in_texture else "aov_arrays",
    }
    names = {"frame_aovs": f"frame_aovs{first}", "aovs": f"aovs{first}"}
    constants = {"parts": parts, "first": first}
    return PassSpec("blend_aovs", constants=constants, names=names, variants=variants)


def aov_shader(spec: PassSpec, variants: Mapping[str, str]) -> Shader:
    """Return the shader of such a pass for frames in buffers, or in textures."""
    packages = ("supersampler.methods.aovs",)
    return load_shader(spec.shader, packages, spec.constants, {**variants, **spec.variants})
