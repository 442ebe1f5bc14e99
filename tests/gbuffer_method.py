"""A minimal method that reads G-buffers, at one ratio, and frames for it."""

import os
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, NamedTuple
from unittest.mock import patch

import numpy as np
import pytest
from torch import Tensor
from torch.nn import functional as F

from noise import noise
from supersampler import Frame
from supersampler.frame import Size
from supersampler.methods.gbuffers import GBUFFERS, grouped
from supersampler.methods.model_file import find_model
from supersampler.methods.spec import DISPLAY, MethodSpec
from supersampler_export.folder import write_model_folder
from supersampler_model.methods.base import Method
from supersampler_model.ops.color import bounded, sanitize
from supersampler_model.ops.images import Size as Extent
from supersampler_model.ops.images import size_of
from supersampler_model.ops.sampling import grid_of, linear, resample

RATIO = 2
WANTED = ("gbuffer_base_color", "gbuffer_display_base_color", "gbuffer_display_normal")
DARK = 0.04


class Step(NamedTuple):
    """Return the image twice: as output and as history."""

    image: Tensor
    history_color: Tensor


class Demodulated(Method):
    """Light (colour over base colour), upsampled and lit again, blended with a tenth of the history."""

    spec: ClassVar = MethodSpec(
        name="demodulated",
        source="a test",
        inputs=(
            "color",
            "jitter",
            "gbuffer_base_color",
            "gbuffer_display_base_color",
            "gbuffer_display_normal",
        ),
        history={"color": (1, 3, *DISPLAY)},
        ratios=(float(RATIO), float(RATIO)),
    )

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w)
        jitter: Tensor,  # (1, 2)
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_display_base_color: Tensor,  # (1, 3, 2 h, 2 w)
        gbuffer_display_normal: Tensor,  # (1, 3, 2 h, 2 w)
        history_color: Tensor,  # (1, 3, 2 h, 2 w)
    ) -> Step:
        """Return the image, (1, 3, 2 h, 2 w)."""
        render = size_of(color)
        grid = grid_of(Extent(RATIO * render.width, RATIO * render.height), render, jitter)
        kernels = grid.bands(render, linear, reach=1)
        light = resample(sanitize(color, 0.0) / (gbuffer_base_color + DARK), *kernels)
        packed = F.pixel_unshuffle(gbuffer_display_base_color, RATIO)  # as a network at render size reads it
        facing = 1.0 + 0.1 * gbuffer_display_normal[:, 2:]
        lit = light * (F.pixel_shuffle(packed, RATIO) + DARK) * facing
        return Step(bounded(0.9 * lit + 0.1 * history_color), bounded(lit) * 1.0)


def exported(folders: pytest.TempPathFactory) -> Path:
    """Folder of the method, traced once for all processes, with the `aovs.onnx` of all folders."""
    base = folders.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / Demodulated.name
    if folder.exists():
        return folder
    aovs, made = find_model("bilinear") / "aovs.onnx", base / "made"
    with patch("supersampler_export.folder.aovs_graph", aovs.read_bytes):
        write_model_folder(Demodulated(), made)
    with suppress(OSError):  # another process was first
        made.rename(folder)
    return folder


def gbuffers(seed: int, render: Size, display: Size) -> dict[str, Any]:
    """All G-buffers of a frame, plausible, by the names of tensors; halves but for depth."""
    random = np.random.default_rng(seed)
    made: dict[str, Any] = {}
    for name, place in GBUFFERS.items():
        array = random.random(place.shape(render, display), np.float32)
        if place.key == "normal":
            array = array - 0.5
            array /= np.linalg.norm(array, axis=-1, keepdims=True)
        made[name] = array if place.key == "depth" else array.astype(np.float16)
    return made


def lit(seed: int, render: Size = (32, 18), *, drop: str = "", **overrides: Any) -> Frame:
    """A frame of noise with all G-buffers; those of `overrides` in place, without the one to drop."""
    display = RATIO * render[0], RATIO * render[1]
    found = {**gbuffers(seed, render, display), **{k: overrides.pop(k) for k in WANTED if k in overrides}}
    found.pop(drop, None)
    gbuffer, gbuffer_display = grouped(found)
    return noise(seed, render, gbuffer=gbuffer, gbuffer_display=gbuffer_display, **overrides)
