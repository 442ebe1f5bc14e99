"""Texts of upscaler.json: the inputs of a frame, the fields of `Params`, the output, and the history."""

from typing import Any

_BASE_COLOR: dict[str, Any] = {
    "channels": 3,
    "unit": "linear base colour",
    "range": [0.0, 1.0],
    "invalid": "NaN and values out of range count as 0",
    "formats": ["rgba8unorm", "rgba16float", "rgba32float"],
}
_NORMAL: dict[str, Any] = {
    "channels": 3,
    "unit": "unit normal in world space; 0 at the sky",
    "range": [-1.0, 1.0],
    "invalid": "NaN and values out of range count as 0",
    "formats": ["rgba16float", "rgba32float"],
}
_AS_COLOR = "where the colour was"
_AT_CENTRES = "at the centres of the display's pixels, without jitter"

INPUTS: dict[str, dict[str, Any]] = {
    "color": {
        "channels": 3,
        "unit": "linear scene RGB times params.pre_exposure, before tone mapping, bloom, depth of field, "
        "motion blur and grain",
        "range": [0.0, 65504.0],
        "sampling": "once a pixel, at its centre + jitter",
        "invalid": "negative values count as 0, larger ones as 65504; a pixel with a NaN is a missing sample",
        "formats": ["rgba16float", "rgba32float"],
    },
    "depth": {
        "channels": 1,
        "unit": "near / view distance: reversed, infinite far plane, 0 at the sky; any constant times "
        "1 / distance works if it is constant between resets",
        "range": [0.0, 1e30],
        "sampling": _AS_COLOR,
        "invalid": "NaN, Inf and negative values prove no disocclusion and are never the closest",
        "formats": ["r32float", "depth32float"],
    },
    "motion": {
        "channels": 2,
        "unit": "(x, y) in render pixels, y down, without jitter, previous minus current: what is at p now "
        "was at p + motion[p] in the previous frame",
        "range": [-1e6, 1e6],
        "sampling": _AS_COLOR,
        "invalid": "NaN and Inf count as no motion; longer vectors are clamped",
        "formats": ["rg16float", "rg32float"],
    },
    "reactive": {
        "channels": 1,
        "unit": "how unreliable the history is (particles, screens, glass): the weight w of this frame "
        "becomes w + (1 - w) reactive",
        "range": [0.0, 1.0],
        "sampling": _AS_COLOR,
        "invalid": "NaN and negative values count as 0, larger ones as 1",
        "formats": ["r8unorm", "r16float", "r32float"],
        "optional": "without a mask set params.has_reactive = 0, and bind a texture of 1x1 or a buffer of "
        "16 bytes",
    },
    "gbuffer_base_color": {**_BASE_COLOR, "sampling": _AS_COLOR},
    "gbuffer_normal": {**_NORMAL, "sampling": _AS_COLOR},
    "gbuffer_display_base_color": {**_BASE_COLOR, "sampling": _AT_CENTRES},
    "gbuffer_display_normal": {**_NORMAL, "sampling": _AT_CENTRES},
    "gbuffer_display_depth": {
        "channels": 1,
        "unit": "as depth, with the same constant",
        "range": [0.0, 1e30],
        "invalid": "NaN, Inf and negative values prove no disocclusion",
        "formats": ["r32float", "depth32float"],
        "sampling": _AT_CENTRES,
    },
}
"""Images of a frame; a buffer holds float32 values, row by row from the top, channels side by side.

G-buffers are textures, also where the other images are in buffers.
"""

AOVS: dict[str, Any] = {
    "unit": "any; blended with the weights of the colour",
    "range": [-65504.0, 65504.0],
    "sampling": _AS_COLOR,
    "invalid": "values out of range are clamped; a NaN is a missing sample of its channel",
    "formats": ["rgba8unorm", "rgba16float", "rgba32float"],
}
"""AOVs of a frame, in addition to its other inputs."""

FIELDS: tuple[tuple[str, int, str], ...] = (
    ("render", 2, "(width, height) of this frame"),
    ("display", 2, "(width, height) of the image"),
    ("previous", 2, "render size of the previous frame; after a reset, of this frame"),
    (
        "jitter",
        2,
        "(x, y) of this frame in render pixels, in [-0.5, 0.5]: samples were taken at pixel centres + jitter",
    ),
    (
        "exposure",
        1,
        "factor of the colour before the tone curve in which colours are compared, in [2^-24, 2^24]; "
        "0: the shaders measure it and adapt",
    ),
    (
        "adds_samples",
        1,
        "1; 0 if the colour of this frame was not sampled but extrapolated; 2 for path tracers, whose "
        "samples never repeat: static pixels are then averaged, and never frozen",
    ),
    ("writes_aux", 1, "1 where `aux` is written, else 0; 16 bytes of `aux` suffice for 0"),
    ("pre_exposure", 1, "factor that the renderer has applied to the colour, in [2^-24, 2^24]; 1: none"),
    ("has_reactive", 1, "1 where the frame has a reactive mask, else 0"),
    (
        "skips",
        1,
        "1: shaders skip frozen tiles; the image is the same. 2: they also leave memory of `next` that holds "
        "a frozen tile already, where each `next` is the `history` of the previous step. 0 if `aux` is read",
    ),
)
"""Fields of `Params` in order: name, number of f32 values, meaning."""

OUTPUT_LAYOUTS = {
    "textures": "linear RGB, alpha 1",
    "buffers": "float32 (display height, display width, 3), linear RGB",
}
AOV_LAYOUTS = {
    "textures": "the four channels of a texture of AOVs each",
    "buffers": "float32 (display height, display width, channels), until the step after the next one",
}
AOV_STEP = "Set params.writes_aux = 1 and params.skips = 0."
AUX = "float32 (display height, display width, 2): weight of the history in the image; 1 where it is frozen"
STEP = (
    "Write params, then dispatch the passes in order. A pass covers a size: dispatch ceil(size / tile) "
    "workgroups in x and y, 1 in z. Each pass reads what earlier ones wrote."
)
SIZES = (
    "A size is (ceil(width / divide) * multiply[0], ceil(height / divide) * multiply[1]) of the size that "
    "`of` names: render, the size of this frame; previous, the size of the previous frame; display, the size "
    "of the image; one, 1x1; signatures, (ceil(w / 4), ceil(h / 4) * phases) of the render size (w, h), with "
    "phases = floor(9 * W * H / (w * h)) + 2 of the display size (W, H); previous_signatures, the same of "
    "the previous render size. A buffer has `bytes` for each pixel of its size, rounded up to 4, and at "
    "least 16; bind exactly this size. Textures may be larger."
)
SWAP = (
    "After a step, the next step reads each `next` as `history`: two buffers that swap. A step writes only a "
    "part of `next_signatures`; the rest was written two steps earlier, to the same buffer."
)
RESET = (
    "All zeros mean no history: clear every `history` resource before the first frame and on a cut, and set "
    "params.previous = params.render."
)
RESIZE = (
    "The history is kept when the render size changes: a `history` resource of size `previous` has the size "
    "of the frame that wrote it, and its `next` the size of this frame. Another display size needs a reset."
)
