"""What kernels ask of a model.json: the history that they know, and constants that they compute with."""

from collections.abc import Mapping
from typing import Any

from supersampler.errors import ModelError
from supersampler.methods.model_file import ModelInfo

_DISPLAY, _HALF = ("display_height", "display_width"), ("half_height", "half_width")
_PREVIOUS, _SHADED = ("previous_height", "previous_width"), ("shaded_height", "shaded_width")
_HISTORIES: Mapping[str, Mapping[str, tuple[int | str, ...]]] = {
    "taa": {"history.color": (1, 3, *_DISPLAY), "history.exposure": (1,)},
    "taau": {
        "history.color": (1, 3, *_DISPLAY),
        "history.samples": (1, 2, *_DISPLAY),
        "history.surface": (1, 3, *_PREVIOUS),
        "history.jitter": (1, 2),
        "history.exposure": (1,),
    },
    "classifier": {
        "history.color": (1, 3, *_DISPLAY),
        "history.state": (1, 3, *_DISPLAY),
        "history.classes": (1, 6, *_HALF),
        "history.depth": (1, 2, *_PREVIOUS),
        "history.jitter": (1, 2),
        "history.exposure": (1,),
    },
    "guided-warp": {
        "history.color": (1, 3, *_SHADED),
        "history.base_color": (1, 3, *_SHADED),
        "history.normal": (1, 3, *_SHADED),
        "history.depth": (1, 1, *_SHADED),
        "history.jitter": (1, 2),
        "history.motion": (1, 2, *_PREVIOUS),
        "history.motion_jitter": (1, 2),
    },
}
_SIGMA, _NUMBER = (1e-3, 1e3), (0.0, 1e6)
_CONSTANTS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "taa": {"alpha": (0.0, 1.0), "gamma": _NUMBER},
    "taau": {
        **dict.fromkeys(("frame_sigma", "sample_sigma", "moment_sigma"), _SIGMA),
        **dict.fromkeys(
            (
                "frame_sharpness", "history_sharpness", "gamma_still", "gamma_moving", "gamma_speed",
                "gamma_time", "spread_samples", "spread_step", "forget", "samples", "blur_cost", "speed_cost",
                "settled", "depth_margin", "depth_ramp", "change_deviation", "change_relative", "change_ramp",
            ),
            _NUMBER,
        ),
    },
    "classifier": {
        **dict.fromkeys(("sample_sigma", "moment_sigma", "kernel_sigma"), _SIGMA),
        **dict.fromkeys(
            ("gamma", "history_sharpness", "samples", "contraction", "depth_margin", "depth_ramp"), _NUMBER
        ),
    },
    "guided-warp": {
        **dict.fromkeys(("surface_sigma", "depth_sigma", "distance_sigma"), _SIGMA),
        "least": _NUMBER,
    },
}  # fmt: skip
_RINGS, _FARTHEST = 7, 64


def has_known_history(info: ModelInfo, kernels: str) -> bool:
    """Whether a model's history lies as the kernels of a method ("taa", say) read and leave it."""
    shapes = {h.input.name: h.input.shape for h in info.history}
    return shapes == _HISTORIES[kernels] and {tensor.name for tensor in info.aux_outputs} <= {"weight"}


def check_constants(info: ModelInfo, kernels: str) -> None:
    """Raise ModelError where one of model.json's constants is none that these kernels compute with."""
    for name, (least, most) in _CONSTANTS[kernels].items():
        value: Any = info.config.get(name)
        if type(value) not in (int, float) or not least <= value <= most:
            raise wrong_constant(info, name, value, f"a number from {least:g} to {most:g}")
    for name in ("corrected", "rectified", "own_motion") if kernels == "classifier" else ():
        if type(info.config.get(name)) is not bool:
            raise wrong_constant(info, name, info.config.get(name), "true or false")


def are_rings(strides: object) -> bool:
    """Whether these are radii of rings of samples, in pixels, from near to far, as `guided-warp` has them."""
    return (
        isinstance(strides, list)
        and 1 <= len(strides) <= _RINGS
        and all(type(stride) is int and 1 <= stride <= _FARTHEST for stride in strides)
        and strides == sorted(strides)
    )


def wrong_constant(info: ModelInfo, name: str, value: Any, want: str) -> ModelError:
    """Return the error for a constant that will not do."""
    return ModelError(f"{info.folder / 'model.json'}: config.{name} is {value!r:.60}; want {want}.")
