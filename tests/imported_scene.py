"""A test scene written in the file layout of each importer, and the frames that importers must return.

It has a sky, jitter, and motion by whole pixels, so that motion vectors lead exactly to the previous frame.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from supersampler import Conventions, Frame, Shot
from supersampler.io.images import write_exr
from supersampler_model.data.scenes.analytic import Plane, checker

SIZE, DISPLAY_SIZE = (64, 36), (128, 72)
JITTER = (0.25, -0.375)
NEAR, DISTANCE = 0.1, 10.0  # of the plane, scene units
SKY_ROWS = 4
COUNT = 3
CUT = 2
SCENE = Plane(checker, (2.0, -1.0))  # it moves right and up: the previous frame shows it at (-2, +1)
PAST = (-2, 1)
MAP = {"color": ["R", "G", "B"], "depth": "depth.V", "motion": ["motion/*.exr:R", "motion/*.exr:G"]}


def color(index: int) -> np.ndarray:
    found = SCENE.frame(index, SIZE, JITTER).color
    assert found is not None
    return found


def distance() -> np.ndarray:
    """View distance of each pixel, (h, w); inf at the sky."""
    pixels = np.full(SIZE[::-1], DISTANCE, np.float32)
    pixels[:SKY_ROWS] = np.inf
    return pixels


def plane(value: float, size: tuple[int, int] = SIZE) -> np.ndarray:
    return np.full(size[::-1], value, np.float32)


def truth(index: int) -> np.ndarray:
    return SCENE.truth(index, DISPLAY_SIZE, 1)


def assert_is_the_scene(shot: Shot) -> None:
    assert (len(shot), shot.render_size) == (COUNT, SIZE)
    before: Frame | None = None
    for index, item in enumerate(shot):
        frame = item.frame
        assert frame.color is not None
        np.testing.assert_allclose(frame.color, color(index), atol=1e-3)
        assert frame.jitter == pytest.approx(JITTER)
        assert frame.reset == (index in (0, CUT))
        assert (frame.depth[:SKY_ROWS] == 0).all()
        np.testing.assert_allclose(frame.depth[SKY_ROWS:], NEAR / DISTANCE, rtol=1e-4)
        if before is not None and before.color is not None:
            vectors = np.rint(frame.motion).astype(int)
            np.testing.assert_allclose(frame.motion, vectors, atol=1e-4)
            rows, columns = np.mgrid[8:28, 8:56]
            found = before.color[rows + vectors[8:28, 8:56, 1], columns + vectors[8:28, 8:56, 0]]
            np.testing.assert_allclose(found, frame.color[8:28, 8:56], atol=1e-3)
        before = frame


def assert_same_shot(copy: Shot, shot: Shot) -> None:
    assert copy.reference_indices == shot.reference_indices
    for a, b in zip(copy, shot, strict=True):
        for name in ("color", "depth", "motion"):
            np.testing.assert_array_equal(getattr(a.frame, name), getattr(b.frame, name))
        assert (a.frame.jitter, a.frame.reset, a.frame.exposure) == (
            b.frame.jitter,
            b.frame.reset,
            b.frame.exposure,
        )
        assert (a.reference is None) == (b.reference is None)


def blender_frame(
    index: int, layer: str, depth: str = "Depth.Z", diffuse: str = "DiffCol"
) -> dict[str, np.ndarray]:
    """One multilayer frame: y of Vector points up, Z is the distance, 1e10 at the sky."""
    rgb = color(index)
    return {
        **{f"{layer}.Combined.{axis}": rgb[..., i].astype(np.float16) for i, axis in enumerate("RGB")},
        f"{layer}.Combined.A": plane(0.5),
        f"{layer}.{depth}": np.where(np.isinf(distance()), np.float32(1e10), distance()),
        f"{layer}.Vector.X": plane(PAST[0]),
        f"{layer}.Vector.Y": plane(-PAST[1]),
        f"{layer}.Vector.Z": plane(77),
        f"{layer}.Vector.W": plane(77),
        **{f"{layer}.Normal.{axis}": plane(i) for i, axis in enumerate("XYZ")},
        **{f"{layer}.{diffuse}.{axis}": plane(0.25 * i) for i, axis in enumerate("RGB")},
    }


def write_blender(folder: Path, *layers: str, **names: str) -> Path:
    for index in range(COUNT):
        frame: dict[str, np.ndarray] = {}
        for layer in layers:
            frame.update(blender_frame(index, layer, **names))
        write_exr(folder / f"kitchen_{index + 8:04d}.exr", frame)  # 8, 9, 10
    write_exr(
        folder / "reference" / "0009.exr",
        {f"Top.Combined.{a}": truth(1)[..., i] for i, a in enumerate("RGB")},
    )
    (folder / "jitter.json").write_text(json.dumps([JITTER] * COUNT))
    return folder


def write_channels(folder: Path, count: int = COUNT) -> Path:
    """Unreal's way: motion in a file of its own, NDC, y up, current minus previous; linear depth."""
    for index in range(count):
        rgb = color(index)
        image = {axis: rgb[..., i].astype(np.float16) for i, axis in enumerate("RGB")}
        write_exr(folder / f"{index:04d}.exr", {**image, "depth.V": distance(), "rough": plane(0.3)})
        motion = {"R": plane(-PAST[0] * 2 / SIZE[0]), "G": plane(PAST[1] * 2 / SIZE[1])}
        write_exr(folder / "motion" / f"{index:04d}.exr", motion)
    return folder


CONVENTIONS = Conventions.unreal(depth="linear", near=NEAR)
UNREAL_JITTER = [(-JITTER[0], -JITTER[1])] * COUNT


def write_safetensors(path: Path, tensors: dict[str, np.ndarray]) -> Path:
    contiguous = {name: np.ascontiguousarray(array) for name, array in tensors.items()}
    save_file(contiguous, path, {"Length": "3", "Version": "test"})
    return path


def arm_tensors(far: float = math.inf) -> dict[str, np.ndarray]:
    """Planes before rows; v before u; y before x; current minus previous; forward depth; ln of exposure."""
    finite = not math.isinf(far)
    p0 = far / (far - NEAR) if finite else 1 + 1e-7
    p1 = -far * NEAR / (far - NEAR) if finite else -NEAR - 1e-7
    device = np.minimum(p0 + p1 / distance(), 1).astype(np.float32)
    frames = range(COUNT)
    return {
        "colour_linear": np.stack([color(i).transpose(2, 0, 1) for i in frames]).astype(np.float16),
        "ground_truth_linear": np.stack([truth(i).transpose(2, 0, 1) for i in frames]).astype(np.float16),
        "motion_lr": np.stack([np.stack([plane(-PAST[1]), plane(-PAST[0])])] * COUNT).astype(np.float16),
        "depth": np.stack([device[None]] * COUNT),
        "depth_params": np.array([[p0, p1, 1.0, 0.5]] * COUNT, np.float32),
        "jitter": np.array([[[[JITTER[1]]], [[JITTER[0]]]]] * COUNT, np.float32),
        "exposure": np.log(np.array([[1.0], [2.0], [4.0]], np.float32)),
        "camera_cut": np.array([[False], [False], [True]]),
        "seq": np.array([[7]] * COUNT, np.int64),
        "EmulatedFramerate": np.array([[60.0]] * COUNT, np.float32),
    }
