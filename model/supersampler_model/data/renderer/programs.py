"""Shader programs, from the .glsl files beside this one."""

from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from supersampler_model.data.renderer.context import VERSION
from supersampler_model.data.scenes.lights import MAX_POINTS
from supersampler_model.data.scenes.scene import MAX_JOINTS

BLOCKS = {"View": 0, "Lights": 1, "Draw": 2, "Surface": 3, "Palettes": 4}
"""Binding points of the uniform blocks of blocks.glsl."""
SAMPLERS = {
    "base_color_map": 0, "normal_map": 1, "orm_map": 2, "emissive_map": 3,
    "environment": 4, "sun_shadow": 5, "spot_shadow": 6, "sample_colors": 0, "sample_normals": 1,
}  # fmt: skip
"""Texture units."""


def source(name: str) -> str:
    """Return the text of shaders/`name`.glsl."""
    return (files("supersampler_model.data.renderer") / "shaders" / f"{name}.glsl").read_text(
        encoding="utf-8"
    )


def build(gl: Any, vertex: Sequence[str], fragment: Sequence[str], defines: Sequence[str] = ()) -> Any:
    """Return the program of these files, each stage's joined in order, with its blocks and samplers bound.

    Args:
        gl: moderngl context.
        vertex: names of files.
        fragment: names of files.
        defines: macros that choose a variant.
    """
    head = [
        f"#version {VERSION} core",
        f"#define MAX_POINTS {MAX_POINTS}",
        f"#define MAX_JOINTS {MAX_JOINTS}",
    ]
    head += [f"#define {name}" for name in defines]
    stages = ("\n".join([*head, *map(source, names)]) for names in (vertex, fragment))
    program = gl.program(*stages)
    for name in program:
        if name in BLOCKS:
            program[name].binding = BLOCKS[name]
        elif name in SAMPLERS:
            program[name].value = SAMPLERS[name]
    return program
