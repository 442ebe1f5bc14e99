"""A small training set with G-buffers of both sizes: smooth waves that pan, exact at any place."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler import Frame, halton_jitter
from supersampler_model.data.dataset import storage
from supersampler_model.data.scenes.analytic import EXTENT, Values, places
from supersampler_model.data.specs import SequenceSpec
from supersampler_model.methods.gbuffer_surfaces import Surfaces

DISPLAY = (64, 36)
VELOCITY = np.array([1.7, -0.8])  # display pixels a frame
FRAMES = 10


def gbuffer_data(folder: Path, *, gbuffers: bool = True) -> storage.Dataset:
    """Write a sequence to train on and one to validate on, at ratio 1 and rendered again at 2."""
    entries = tuple(
        storage.SequenceEntry(
            spec=SequenceSpec(family="fences", seed=1, frames=FRAMES), ratio=1.0, split=split
        )
        for split in ("train", "validation")
    )
    description = storage.Description(
        display_size=DISPLAY, samples=1, gbuffers=gbuffers, seed=0, sequences=entries
    )  # fmt: skip
    made = storage.create_dataset(folder, description)
    again = made.at(2)
    for entry, other in zip(entries, again.entries(), strict=True):
        for index in range(FRAMES):
            storage.write_training_frame(made.path(entry, index), frame(index, gbuffers=gbuffers))
            storage.write_rerendered(again.rerendered_path(other, index), rendered(index, 2))
    return made


def frame(index: int, *, gbuffers: bool = True) -> storage.TrainingFrame:
    there = surface(index, DISPLAY, (0.0, 0.0))
    color, depth, motion, jitter, _ = rendered(index, 1)
    alias = (there["roughness"] > 0.6).astype(np.uint8)
    return storage.TrainingFrame(
        color=color, depth=depth, motion=motion, jitter=jitter, reset=index == 0, exposure=1.0 + 0.1 * index,
        reference=there["base_color"].astype(np.float16), ghost=np.zeros_like(alias), alias=alias,
        gbuffer_display=there if gbuffers else None,
    )  # fmt: skip


def training_frame(frame: Frame, reference: NDArray[Any]) -> storage.TrainingFrame:
    """A frame of an analytic scene, with its exposure and without classes."""
    assert frame.color is not None
    nothing = np.zeros(reference.shape[:2], np.uint8)
    return storage.TrainingFrame(
        color=frame.color, depth=frame.depth, motion=frame.motion, jitter=frame.jitter, reset=frame.reset,
        exposure=1.0, reference=reference, ghost=nothing, alias=nothing, gbuffer=dict(frame.gbuffer or {}),
    )  # fmt: skip


def rendered(index: int, ratio: int) -> storage.Rerendered:
    size, jitter = (DISPLAY[0] // ratio, DISPLAY[1] // ratio), halton_jitter(index, float(ratio))
    seen = surface(index, size, jitter)
    motion = np.broadcast_to(-VELOCITY / ratio, (*size[::-1], 2))
    return storage.Rerendered(
        color=seen["base_color"].astype(np.float16),  # everything shines by itself
        depth=seen.pop("depth"),
        motion=motion.astype(np.float16),
        jitter=jitter,
        gbuffer=seen,
    )


def surface(index: int, size: tuple[int, int], offset: tuple[float, float]) -> dict[str, NDArray[Any]]:
    """G-buffers at pixel centres + offset; above the horizon is sky."""
    x, y = places(size, offset)
    sky = y < 0.1 * EXTENT[1]
    x, y = (v - index * moved for v, moved in zip((x, y), VELOCITY, strict=True))  # a unit is a display pixel
    normal = np.stack([np.sin(0.3 * x), np.cos(0.25 * y + 0.1 * x), np.ones_like(x)], axis=-1)
    normal = np.where(sky[..., None], 0.0, normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    return {
        "base_color": np.stack([wave(x, y), wave(1.3 * x, -y), wave(-y, 0.6 * x)], axis=-1),
        "normal": normal.astype(np.float16),
        "roughness": wave(y, x),
        "metallic": wave(x + y, 0.5 * y),
        "specular": wave(0.4 * x, x + y),
        "depth": wave(x, y).astype(np.float32),
    }


def wave(x: Values, y: Values) -> Values:
    return 0.5 + 0.25 * np.sin(0.3 * x + 0.2 * y) + 0.2 * np.cos(0.15 * x - 0.3 * y)


def surfaces_of(base_color: Tensor) -> Surfaces:
    """Rough dielectrics that face the eye, with this base colour."""
    one = torch.ones_like(base_color[:, :1])
    normal = torch.cat([0.0 * one, 0.0 * one, one], dim=1)
    return Surfaces(base_color, normal, 0.8 * one, 0.0 * one, 0.5 * one, 0.5 * one)


def surfaces(side: int, **fields: Tensor) -> Surfaces:
    """Rough, grey dielectrics that face the eye, but for these fields."""
    return surfaces_of(torch.full((1, 3, side, side), 0.5))._replace(**fields)
