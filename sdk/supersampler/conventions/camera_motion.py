"""Motion vectors of a static scene under a moving camera, for renderers that write none."""

from ctypes import c_float
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from supersampler.arguments import as_number, checked_choice, ieee_arithmetic
from supersampler.backends.cpu.library import Image, cpu_library, readable
from supersampler.conventions.jitter import checked_matrix, finite_jitter
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Array, Float32, as_array

Matrix = NDArray[np.float64]
ClipDepth = Literal["zero_to_one", "minus_one_to_one"]

_PARALLEL = 1e-5  # maximum relative deviation of parallel matrix rows: rounding of float32 matrices


@ieee_arithmetic
def camera_motion(
    depth: Array,
    view_projection: ArrayLike,
    previous_view_projection: ArrayLike,
    *,
    jitter: tuple[float, float] = (0.0, 0.0),
    near: float | None = None,
    clip: ClipDepth = "zero_to_one",
) -> Float32:
    """Return `Frame.motion` of static geometry: where the previous camera saw each sample.

    Depth places each sample in clip space; previous_view_projection @ inverse(view_projection) maps it to the
    previous clip space. The sky moves as the camera turns. Moving objects must write their own motion.

    Args:
        depth: (h, w), row 0 on top. Without `near`, the depth buffer's values in [0, 1], as `view_projection`
            writes them: perspective or orthographic, reversed or not. With `near`, `Frame.depth`: near / view
            distance, 0 at the sky (perspective only).
        view_projection: (4, 4) of this frame, projection @ view, without jitter; row-major, acting on column
            vectors; clip space y points up. Transpose the matrices of an engine with row vectors (Direct3D,
            Unreal); negate row 1 of a Vulkan projection whose y points down.
        previous_view_projection: as `view_projection`, of the previous frame.
        jitter: (x right, y down) of this frame, in render pixels.
        near: the distance that `Frame.depth` is relative to, > 0.
        clip: range of z / w in clip space that the depth buffer maps to [0, 1]: "zero_to_one" (Direct3D,
            Vulkan, Metal, WebGPU, OpenGL with glClipControl) or "minus_one_to_one" (OpenGL).

    Returns:
        (h, w, 2) float32: previous minus current, render pixels, x right and y down, without jitter. The
        vector of a sample behind the previous camera points out of the image.

    Raises:
        LibraryError: the CPU library cannot be loaded.
        ArgumentError: `depth` is not (h, w) of floats, a matrix is not 4 x 4, finite and invertible, `jitter`
            is not two finite numbers, `near` is not > 0 or was given with a matrix that is not perspective.
    """
    buffer = as_array("depth", depth, ArgumentError)
    if buffer.ndim != 2 or 0 in buffer.shape or buffer.dtype.kind != "f":
        raise ArgumentError("depth", got=shown(buffer), want="(h, w) floats, at least one pixel")
    buffer = readable(buffer)
    current = checked_matrix("view_projection", view_projection).astype(np.float64)
    previous = checked_matrix("previous_view_projection", previous_view_projection).astype(np.float64)
    if checked_choice("clip", clip, get_args(ClipDepth)) == "minus_one_to_one":
        current[2] = (current[2] + current[3]) / 2.0  # as in the depth buffer; x, y and w are unchanged
    to_clip, far_depth = _to_clip_space(current, near)
    to_clip[2, 3] += to_clip[2, 2] * far_depth  # depth relative to the far plane loses no bits there
    try:
        from_clip = np.linalg.inv(current)
    except np.linalg.LinAlgError:
        got = shown(current.tolist())
        raise ArgumentError("view_projection", got=got, want="an invertible matrix") from None
    to_previous = np.ascontiguousarray(previous @ from_clip @ to_clip)
    height, width = buffer.shape
    motion = np.empty((height, width, 2), np.float32)
    offset = (c_float * 2)(*finite_jitter(jitter))
    images = Image.of(buffer), Image.of(motion)
    cpu_library().call(
        "ss_camera_motion", images[0], width, height, to_previous.ctypes.data, far_depth, offset, images[1]
    )
    return motion


def _to_clip_space(matrix: Matrix, near: float | None) -> tuple[Matrix, float]:
    """Return the matrix from (x, y, depth, 1) to clip space / w, and the depth of the far plane, 0 or 1."""
    # In a perspective projection, z / w = far + slope / w: the rows of z and w have parallel directions.
    z, w = matrix[2], matrix[3]
    squared = float(w[:3] @ w[:3])
    far = float(z[:3] @ w[:3]) / squared if squared > 0.0 else 0.0
    to_clip: Matrix = np.eye(4)
    if near is None:
        return to_clip, float(np.rint(np.clip(far, 0.0, 1.0)))
    distance = as_number(near)
    if distance is None or not 0.0 < distance < np.inf:
        raise ArgumentError("near", got=shown(near), want="a distance > 0")
    if squared == 0.0 or np.abs(z[:3] - far * w[:3]).max() > _PARALLEL * np.sqrt(squared):
        want = "None, as the projection is orthographic or has an oblique near plane"
        hint = "Pass the depth buffer's own values."
        raise ArgumentError("near", got=shown(near), want=want, hint=hint)
    to_clip[2, 2:] = (z[3] - far * w[3]) / distance, far
    return to_clip, 0.0
