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


def textured(size: Size, offset: tuple[float, float] = (0.0, 0.0), moved: float = 0.0) -> dict[str, Any]:
    """G-buffers of tiles with textures and different depths, below a sky."""
    x = (np.arange(size[0]) + 0.5 + offset[0])[None] / size[0] + moved
    y = (np.arange(size[1]) + 0.5 + offset[1])[:, None] / size[1]
    tile = np.floor(5.0 * x) + 2.0 * np.floor(4.0 * y)
    base = [0.5 + 0.4 * np.sin(k * tile + 40.0 * x) * np.cos(30.0 * y + k) for k in (1.0, 2.0, 3.0)]
    normal = np.stack([np.sin(tile), np.cos(tile + 8.0 * x), np.ones_like(tile + y)], -1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    sky = np.broadcast_to(y < 0.15, tile.shape)
    normal[sky] = 0.0
    depth = np.where(sky, 0.0, 0.05 * (1.0 + tile % 3))
    found = {"base_color": np.stack(base, -1), "normal": normal, "depth": depth}
    return {name: image.astype(np.float32) for name, image in found.items()}


def lit(seed: int, render: Size = (32, 18), *, drop: str = "", **overrides: Any) -> Frame:
    """A frame of noise with all G-buffers; those of `overrides` in place, without the one to drop."""
    display = RATIO * render[0], RATIO * render[1]
    found = {**gbuffers(seed, render, display), **{k: overrides.pop(k) for k in WANTED if k in overrides}}
    found.pop(drop, None)
    gbuffer, gbuffer_display = grouped(found)
    return noise(seed, render, gbuffer=gbuffer, gbuffer_display=gbuffer_display, **overrides)
