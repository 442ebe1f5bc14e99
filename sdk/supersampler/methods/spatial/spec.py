"""Definitions of `bilinear` and `bicubic`, the baselines without a history."""

from dataclasses import replace

from supersampler.methods.registry import register
from supersampler.methods.spec import MethodSpec

BILINEAR = register(
    MethodSpec(
        name="bilinear",
        source="bilinear interpolation",
        inputs=("color", "jitter", "pre_exposure", "display_size"),
        torch="supersampler_model.methods.spatial:Bilinear",
        cpu="bilinear",
    )
)
BICUBIC = register(
    replace(
        BILINEAR,
        name="bicubic",
        source="Catmull-Rom interpolation (a = -0.5)",
        torch="supersampler_model.methods.spatial:Bicubic",
        cpu="bicubic",
    )
)
