"""Definition of `taa`: variance clipping as Salvi presented it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, Literal

from supersampler.methods.registry import register
from supersampler.methods.spec import DISPLAY, MapOf, MethodSpec, Range, UnitFloat, constants_of


@dataclass(frozen=True)
class TaaConfig:
    """Choices that Salvi names. The defaults are his, except for YCoCg: he leaves the colour space open."""

    alpha: UnitFloat = 0.1
    """Weight of the new frame ("typically we blend 10 %")."""
    gamma: Annotated[float | None, Range(0.0, 1e6)] = 1.0
    """Half size of the variance box in standard deviations; None only clips to minimum and maximum."""
    intersect_extent: bool = True
    """Clamp the variance box to the minimum and maximum ("to make sure our AABB is not significantly larger
    than the old AABB")."""
    clip: Literal["sample", "center", "clamp"] = "sample"
    """Clip towards the new sample (Salvi), clip towards the box's centre, or clamp each channel."""
    space: Literal["ycocg", "rgb"] = "ycocg"
    """Colour space of the box ("RGB, YCoCg, etc.")."""
    window: Literal[3, 5, 7] = 3
    """Side of the window of the moments, samples. Each blur of the moments adds 2 ("we can apply it over
    large windows by pre-filtering the first two colour moments"; 7x7 on his slides)."""


def _kernels_support(config: Mapping[str, Any]) -> bool:
    """Return whether all choices but the constants are the defaults, which kernels are written for."""
    fixed = {name: value for name, value in asdict(TaaConfig()).items() if name not in constants_of(TAA)}
    return config.get("gamma") is not None and fixed.items() <= config.items()


TAA = register(
    MethodSpec(
        name="taa",
        source="Salvi, An Excursion in Temporal Supersampling, GDC 2016",
        inputs=("color", "motion", "reactive", "jitter", "exposure", "pre_exposure", "display_size"),
        history={
            "color": (1, 3, *DISPLAY),  # linear RGB
            "exposure": (1,),  # see `followed_exposure`; 0: none yet
        },
        aux_outputs=("weight",),
        maps={"weight": MapOf("weight", 0, 1)},
        config=TaaConfig,
        torch="supersampler_model.methods.taa:Taa",
        cpu="taa",
        gpu="supersampler.methods.taa.gpu:taa_program",
        kernels_support=_kernels_support,
    )
)
