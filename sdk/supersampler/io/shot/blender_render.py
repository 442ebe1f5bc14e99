"""Shots that `supersampler blender` renders: frames are read while they appear, or later."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np

from supersampler.conventions import Conventions, RawFrame, camera_motion, jittered_projection
from supersampler.errors import ShotError
from supersampler.frame import GBUFFER_CHANNELS, Array, Float32, Size
from supersampler.io.image_reading import read_exr, read_types
from supersampler.io.shot.blender import aov_names, layer_map
from supersampler.io.shot.format import FrameEntry, ShotInfo
from supersampler.io.shot.frame_files import check_size, take
from supersampler.io.shot.render_record import (
    RENDER_FILE,
    Camera,
    RenderedScene,
    RenderRecord,
    read_render_record,
)
from supersampler.io.shot.shot import Shot

_SKY = 1e10  # Z where nothing is


def import_render(folder: Path | str) -> Shot:
    """Open the frames that `supersampler blender` has rendered into a folder, as a Shot.

    Raises:
        ShotError: render.json is missing or damaged, or lists no frame.
    """
    folder = Path(folder)
    record = read_render_record(folder)
    if not record.cameras:
        raise ShotError(folder, "has no complete frame", "Give `supersampler blender` again: it continues.")
    return rendered_shot(folder, record, len(record.cameras), record.cameras.__getitem__)


def rendered_shot(
    folder: Path,
    record: RenderRecord,
    count: int,
    camera_of: Callable[[int], Camera],
    stop_waiting: Callable[[], None] = lambda: None,
) -> Shot:
    """Return a Shot of frames that need not exist yet.

    Vectors are corrected, as measured with Blender 4.5. Those of Cycles hold no change of the lens shift, and
    none of the sky. Those of Eevee hold both, and the jitter's. Workbench writes none, and gets the camera's.

    Args:
        folder: of the frames.
        record: what is rendered; its scene is known.
        count: number of frames.
        camera_of: returns the camera of a frame, by its index, when its file is complete; ShotError where it
            never will be.
        stop_waiting: makes a `camera_of` that waits raise ShotError.
    """
    scene, first, jitter = record.scene, record.first, record.jitter
    if scene is None:
        raise ShotError(folder / RENDER_FILE, "does not describe the scene", "Render it again.")
    info = ShotInfo(
        name=scene.name,
        render_size=scene.render_size,
        display_size=scene.display_size,
        frame_rate=scene.frame_rate,
        conventions=Conventions.blender(),
        first_number=first,
    )
    entries = [
        FrameEntry(file=frame_file(first + i), jitter=jitter[i % len(jitter)], reset=i == 0)
        for i in range(count)
    ]

    def read_raw(index: int, gbuffers: Collection[str] | None) -> RawFrame:
        now, before = camera_of(index), None if index == 0 else camera_of(index - 1)
        path = folder / entries[index].file
        arrays, names = _arrays(path, scene, gbuffers)
        jitters = entries[index].jitter, entries[max(0, index - 1)].jitter
        motion = None if before is None else _motion(arrays, scene.engine, (now, before), jitters)
        return RawFrame(
            color=arrays["color"],
            depth=arrays["depth"],
            motion=np.zeros((*arrays["depth"].shape, 2), np.float32) if motion is None else motion,
            jitter=entries[index].jitter,
            reset=entries[index].reset,
            gbuffer={name: arrays[name] for name in GBUFFER_CHANNELS if name in arrays} or None,
            aovs=arrays.get("aovs"),
            aov_names=names,
        )

    color = f"{scene.layer}.Combined.R"
    return Shot(
        folder, info, entries, read_raw, _no_reference, stop_waiting=stop_waiting, color_channel=color
    )


def frame_file(number: int) -> str:
    """Return the name of a frame's file."""
    return f"{number:04d}.exr"


def _no_reference(index: int) -> NoReturn:
    raise IndexError(f"frame {index} has no reference")


def _arrays(
    path: Path, scene: RenderedScene, gbuffers: Collection[str] | None
) -> tuple[dict[str, Array], list[str]]:
    """Read the arrays of a frame; also return the names of its AOVs."""
    names = layer_map(path, read_types(path), scene.layer, motion=False)
    names.pop("motion_next", None)  # the next frame's camera, which it lacks, may not be known yet
    aovs = names.get("aovs", [])
    wanted = {
        name: channels
        for name, channels in names.items()
        if gbuffers is None or name not in GBUFFER_CHANNELS or f"gbuffer_{name}" in gbuffers
    }
    only = [name for each in wanted.values() for name in each]
    channels = read_exr(path, only=only, outside={names["depth"][0]: _SKY})
    check_size(path, channels, scene.render_size)
    arrays = {name: take(path, channels, each) for name, each in wanted.items()}
    arrays["depth"] = arrays["depth"].astype(np.float32, copy=False)
    if len(aovs) == 1:
        arrays["aovs"] = arrays["aovs"][..., None]
    return arrays, aov_names(aovs, scene.layer)


def _motion(
    arrays: Mapping[str, Array],
    engine: str,
    cameras: tuple[Camera, Camera],
    jitters: tuple[tuple[float, float], tuple[float, float]],
) -> Float32:
    """Return the vectors of a frame in Blender's conventions: previous minus current, pixels, y up."""
    (now, before), depth = cameras, arrays["depth"]
    if engine.startswith("BLENDER_EEVEE"):
        change = np.subtract(*jitters) * (-1.0, 1.0)  # of the jitter, y up
        return arrays["motion"].astype(np.float32, copy=False) + change.astype(np.float32)
    unknown = depth >= _SKY
    if "motion" in arrays:
        shift = np.subtract(now.shift, before.shift).astype(np.float32)  # what is seen moves against it
        motion: Float32 = arrays["motion"].astype(np.float32, copy=False) + shift
    else:
        motion, unknown = np.zeros((*depth.shape, 2), np.float32), np.ones(depth.shape, bool)
    is_parallel = not now.matrix[3, :3].any()  # then the sky is of one colour
    if is_parallel or not unknown.any():
        return motion
    size = depth.shape[1], depth.shape[0]
    matrices = [_without_jitter(c, jitter, size) for c, jitter in zip(cameras, jitters, strict=True)]
    near = np.divide(1.0, depth, out=np.zeros_like(depth), where=depth < _SKY)
    moved = camera_motion(near, *matrices, jitter=jitters[0], near=1.0, clip="minus_one_to_one")
    motion[unknown] = (moved * np.array([1.0, -1.0], np.float32))[unknown]
    return motion


def _without_jitter(camera: Camera, jitter: tuple[float, float], size: Size) -> Array:
    return jittered_projection(camera.matrix, (-jitter[0], -jitter[1]), size)
