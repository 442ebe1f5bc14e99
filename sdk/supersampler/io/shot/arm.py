"""Import sequences of Arm's neural-graphics-model-gym from safetensors files."""

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ShotError
from supersampler.frame import Array, Float32
from supersampler.io.files import SHOT_FRAMES, image_size_problem
from supersampler.io.safetensors import open_safetensors
from supersampler.io.shot.format import FrameEntry, ShotInfo
from supersampler.io.shot.shot import Shot

_SHAPES = {
    "colour_linear": (3, "h", "w"), "motion_lr": (2, "h", "w"), "depth": (1, "h", "w"),
    "depth_params": (4,), "jitter": (2, 1, 1),
}  # fmt: skip
_TRUTH = "ground_truth_linear"
_LARGEST_LOGARITHM = 80.0  # maximum log exposure; exp overflows float32 at 88


def import_arm(path: Path | str, *, name: str | None = None) -> Shot:
    """Open a sequence of Arm's neural-graphics-model-gym as a Shot; its ground truth is the references.

    Tensors: `colour_linear` (T, 3, h, w), `motion_lr` (T, 2, h, w; v before u, pixels, current minus
    previous), `depth` (T, 1, h, w; 0 near, 1 far) with `depth_params` (T, 4; FSR2's device to view depth),
    `jitter` (T, 2, 1, 1; y before x, pixels). Optional: `ground_truth_linear` (T, 3, H, W), `exposure` (T, 1;
    natural logarithm), `camera_cut` (T, 1), `seq` (T, 1), `EmulatedFramerate` (T, 1). Vectors are reordered
    to x before y, and depth is converted to near / view distance. `Conventions.arm_gym()` states the motion's
    direction.

    Args:
        path: the file; pixels are read on access.
        name: name of the shot; by default the file's.

    Raises:
        ShotError: the file is missing or damaged, or a tensor is missing or of another shape.
    """
    path = Path(path)
    tensors, _ = open_safetensors(path)
    _check_shapes(path, tensors)
    _check_values(path, tensors)
    count, _, height, width = tensors["colour_linear"].shape
    truth, rate = tensors.get(_TRUTH), tensors.get("EmulatedFramerate")
    info = ShotInfo(
        name=name or path.stem,
        render_size=(width, height),
        display_size=None if truth is None else (truth.shape[3], truth.shape[2]),
        frame_rate=None if rate is None else float(rate.ravel()[0]),
        conventions=Conventions.arm_gym(depth="reversed_infinite"),
    )
    entries = [_entry(path, tensors, index) for index in range(count)]

    def arrays(index: int, _: Collection[str] | None) -> RawFrame:
        return RawFrame(
            color=_image(tensors["colour_linear"], index),
            depth=_reversed_depth(tensors, index),
            motion=np.ascontiguousarray(_image(tensors["motion_lr"], index)[..., ::-1]),
        )

    def reference(index: int) -> Float32:
        return _image(tensors[_TRUTH], index).astype(np.float32)

    return Shot(path, info, entries, arrays, reference)


def _check_shapes(path: Path, tensors: dict[str, NDArray[Any]]) -> None:
    """Check the shapes of the tensors against the number and size of the colour frames."""
    for name, rest in _SHAPES.items():
        if name not in tensors:
            found = ", ".join(sorted(tensors)) or "nothing"
            raise ShotError(path, f"has no tensor {name}", f"It has {found}.")
        frames, size = tensors["colour_linear"].shape[:1], tensors["colour_linear"].shape[2:]
        sides = dict(zip(("h", "w"), size, strict=False))
        want = (*frames, *(sides.get(str(side), side) for side in rest))
        if tensors[name].shape != want or len(want) != len(rest) + 1:
            problem = f"tensor {name} is {tensors[name].shape}; want (frames, {', '.join(map(str, rest))})"
            raise ShotError(path, problem, f"It has {frames} frames of (h, w) {size}.")
    count = len(tensors["colour_linear"])
    if not 1 <= count <= SHOT_FRAMES:
        raise ShotError(path, f"has {count} frames; want 1 to {SHOT_FRAMES}")
    truth = tensors.get(_TRUTH)
    if truth is not None and (truth.ndim != 4 or truth.shape[:2] != (count, 3)):
        raise ShotError(path, f"tensor {_TRUTH} is {truth.shape}; want ({count}, 3, H, W)")
    for name in ("exposure", "camera_cut", "seq"):
        if name in tensors and (tensors[name].shape[:1] != (count,) or tensors[name].size != count):
            problem = f"tensor {name} is {tensors[name].shape}; want a value for each of {count} frames"
            raise ShotError(path, problem)


def _check_values(path: Path, tensors: dict[str, NDArray[Any]]) -> None:
    """Check image sizes, element types, and the values of small tensors."""
    for name in {*_SHAPES, _TRUTH} & tensors.keys():
        if tensors[name].dtype.kind != "f":
            raise ShotError(path, f"tensor {name} is {tensors[name].dtype}; want floating point")
    for name in {"colour_linear", _TRUTH} & tensors.keys():
        if (problem := image_size_problem(*tensors[name].shape[:1:-1])) is not None:
            raise ShotError(path, f"tensor {name} {problem}")
    planes = tensors["depth_params"][:, :2].astype(np.float64)
    if not (np.isfinite(planes).all() and (planes != 0).all()):
        raise ShotError(
            path, "tensor depth_params holds 0, NaN or an infinity; want finite numbers other than 0"
        )
    exposure = tensors.get("exposure")
    if exposure is not None and not (np.abs(exposure.astype(np.float64)) <= _LARGEST_LOGARITHM).all():
        want = f"natural logarithms from -{_LARGEST_LOGARITHM:g} to {_LARGEST_LOGARITHM:g}"
        raise ShotError(path, f"tensor exposure holds other numbers than {want}")
    rate = tensors.get("EmulatedFramerate")
    if rate is not None and not (rate.size and 0 < float(rate.ravel()[0]) < float("inf")):
        raise ShotError(path, "tensor EmulatedFramerate is not a number > 0")


def _entry(path: Path, tensors: dict[str, NDArray[Any]], index: int) -> FrameEntry:
    y, x = (float(value) for value in tensors["jitter"][index].ravel())
    cut = "camera_cut" in tensors and bool(tensors["camera_cut"][index].any())
    other = "seq" in tensors and bool((tensors["seq"][index] != tensors["seq"][index - 1]).any())
    logarithm = float(tensors["exposure"][index].ravel()[0]) if "exposure" in tensors else None
    return FrameEntry(
        file=path.name,
        jitter=(x, y),
        reset=index == 0 or cut or other,
        exposure=None if logarithm is None else math.exp(logarithm),
        reference=path.name if _TRUTH in tensors else None,
    )


def _image(tensor: NDArray[Any], index: int) -> Array:
    """Return a copy of one frame as (h, w, k)."""
    return np.ascontiguousarray(tensor[index].transpose(1, 2, 0))


def _reversed_depth(tensors: dict[str, NDArray[Any]], index: int) -> Float32:
    """Return near / view distance, with the first frame's near plane; 0 at the far plane.

    The view distance is p1 / (device - p0), as in FSR2; the near plane is where device depth is 0.
    """
    device = np.asarray(tensors["depth"][index, 0], np.float32)
    first, (p0, p1) = tensors["depth_params"][0], tensors["depth_params"][index, :2]
    near = -first[1] / first[0]
    return np.where(device >= 1, np.float32(0), near * (device - p0) / p1).astype(np.float32, copy=False)
