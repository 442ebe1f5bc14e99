"""What `bilinear` and `bicubic` are: the baselines without a history."""

from dataclasses import replace

from supersampler.methods.spec import MethodSpec

BILINEAR = MethodSpec(
    name="bilinear",
    source="bilinear interpolation",
    inputs=("color", "jitter", "pre_exposure", "display_size"),
)
BICUBIC = replace(BILINEAR, name="bicubic", source="Catmull-Rom interpolation (a = -0.5)")
