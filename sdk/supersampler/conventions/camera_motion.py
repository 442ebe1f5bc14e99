"""Motion vectors of a static scene under a moving camera, for renderers that write none."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from supersampler.arguments import as_number, checked_choice, ieee_arithmetic
from supersampler.backends.cpu.kernel_loader import kernel_if_possible
from supersampler.backends.cpu.structs import Floats, pack
from supersampler.conventions.jitter import checked_matrix, finite_jitter
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Array, Float32, as_array

Matrix = NDArray[np.float64]
ClipDepth = Literal["zero_to_one", "minus_one_to_one"]

BEHIND = np.float32(1e-6)
"""Minimum ratio of W in the previous and the current clip space; below it, a point was behind the camera."""
_LANES = 16  # minimum width of the kernel's images
_PARALLEL = 1e-5  # of the depth row to the w row of a matrix: the rounding of float32 matrices


class MotionTables(NamedTuple):
    """A depth buffer, and the coefficients of its motion.

    At (x, y) with depth d, counted from the farthest depth, the motion is N / W with
        N = columns[0] d + columns[1] rows[0] + columns[2] in x,
        N = rows[1] d + rows[2] columns[3] + rows[3] in y,
        W = depth_w d + columns[4] + rows[4].

    Attributes:
        motion: (height, width, 2) render pixels, written to.
        depth: (height, width).
        columns: (5, width) factor of depth, factor of y, rest, x in clip space, part of W.
        rows: (height, 5) y in clip space, factor of depth, factor of x, rest, part of W.
        depth_w: factor of depth in W.
        far_depth: the farthest depth.
        width, height: size of the image.
    """

    motion: Floats
    depth: Floats
    columns: Floats
    rows: Floats
    depth_w: float
    far_depth: float
    width: int
    height: int


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

    The depth places each sample in clip space, and previous_view_projection @ inverse(view_projection) takes
    it to the previous clip space. The sky moves as the camera turns. Moving objects must
    write their own motion.

    Args:
        depth: (h, w), row 0 on top. Without `near`, the depth buffer's values in [0, 1], as `view_projection`
            writes them: perspective or orthographic, reversed or not. With `near`, `Frame.depth`: near / view
            distance, 0 at the sky (perspective only).
        view_projection: (4, 4) of this frame, projection @ view, without jitter; row-major, acting on column
            vectors; clip space y points up. Transpose the matrices of an engine with row vectors (Direct3D,
            Unreal); negate row 1 of a Vulkan projection whose y points down.
        previous_view_projection: the same for the previous frame.
        jitter: (x right, y down) of this frame, in render pixels.
        near: the distance that `Frame.depth` is relative to, > 0.
        clip: clip space depth / w of what the depth buffer shows as 0 to 1: "zero_to_one" (Direct3D, Vulkan,
            Metal, WebGPU, OpenGL with glClipControl) or "minus_one_to_one" (OpenGL).

    Returns:
        (h, w, 2) float32: previous minus current, render pixels, x right and y down, without jitter. What was
        behind the previous camera gets a vector that points out of the image.

    Raises:
        ArgumentError: `depth` is not (h, w) of floats, a matrix is not 4 x 4, finite and invertible, `jitter`
            is not two finite numbers, `near` is not > 0 or was given with a matrix that is not perspective.
    """
    buffer = _checked_depth(depth)
    current = checked_matrix("view_projection", view_projection).astype(np.float64)
    previous = checked_matrix("previous_view_projection", previous_view_projection).astype(np.float64)
    if checked_choice("clip", clip, get_args(ClipDepth)) == "minus_one_to_one":
        current[2] = (current[2] + current[3]) / 2.0  # as in the depth buffer; X, Y and W are unchanged
    to_clip, far_depth = _to_clip_space(current, near)
    to_clip[2, 3] += to_clip[2, 2] * far_depth  # depth counts from there: far away none of it is rounded
    tables = _tables(buffer, previous @ _inverse(current) @ to_clip, finite_jitter(jitter), far_depth)
    kernel = kernel_if_possible("conventions.kernels.write_motion") if tables.width >= _LANES else None
    if kernel is None:
        write_motion_numpy(tables)
    else:
        kernel(pack(tables))
    return tables.motion


def _checked_depth(depth: Array) -> Float32:
    array = as_array("depth", depth, ArgumentError)
    if array.ndim != 2 or 0 in array.shape:
        raise ArgumentError("depth", got=f"of shape {array.shape}", want="(h, w), at least one pixel")
    if array.dtype.kind != "f":
        raise ArgumentError("depth", got=array.dtype, want="floats")
    return np.ascontiguousarray(array, np.float32)


def _inverse(view_projection: Matrix) -> Matrix:
    try:
        return np.linalg.inv(view_projection).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        got = shown(view_projection.tolist())
        raise ArgumentError("view_projection", got=got, want="an invertible matrix") from None


def _to_clip_space(matrix: Matrix, near: float | None) -> tuple[Matrix, float]:
    """Return the matrix from (x, y, depth, 1) to clip space / w, and the depth of the farthest, 0 or 1."""
    # In a perspective, z / w = far + slope / w: the rows of z and w have parallel directions.
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


def _tables(depth: Float32, m: Matrix, jitter: tuple[float, float], far_depth: float) -> MotionTables:
    """Return the coefficients of the motion, from the matrix to the previous clip space.

    With (X, Y, Z, W) = m @ (x, y, depth, 1), the motion is X / W - x = (X - x W) / W. Where the camera hardly
    moves, X / W and x are nearly equal and their difference in single precision is noise; X - x W has its
    differences in the coefficients, which are of double precision.
    """
    height, width = depth.shape
    x = (np.arange(width) + 0.5 + jitter[0]) * (2.0 / width) - 1.0
    y = 1.0 - (np.arange(height) + 0.5 + jitter[1]) * (2.0 / height)
    x_rest = (m[0, 0] - m[3, 3] - m[3, 0] * x) * x + m[0, 3]
    y_rest = (m[1, 1] - m[3, 3] - m[3, 1] * y) * y + m[1, 3]
    of_x = np.stack([m[0, 2] - m[3, 2] * x, m[0, 1] - m[3, 1] * x, x_rest]) * (width / 2.0)
    of_y = np.stack([m[1, 2] - m[3, 2] * y, m[1, 0] - m[3, 0] * y, y_rest]) * (-height / 2.0)  # y down
    columns = np.stack([*of_x, x, m[3, 0] * x]).astype(np.float32)
    rows = np.stack([y, *of_y, m[3, 1] * y + m[3, 3]], axis=1).astype(np.float32)
    motion = np.empty((height, width, 2), np.float32)
    return MotionTables(motion, depth, columns, rows, float(m[3, 2]), far_depth, width, height)


def write_motion_numpy(tables: MotionTables) -> None:
    """Write the motion as the kernel does, but for rounding, without a compiler and at any width."""
    x_depth, x_y, x_rest, x, x_w = tables.columns
    y, y_depth, y_x, y_rest, y_w = tables.rows.T[..., None]
    d = tables.depth - np.float32(tables.far_depth)
    w = np.float32(tables.depth_w) * d + x_w + y_w
    behind = w < BEHIND
    w[behind] = 1.0
    np.divide(x_depth * d + x_y * y + x_rest, w, out=tables.motion[..., 0])
    np.divide(y_depth * d + y_x * x + y_rest, w, out=tables.motion[..., 1])
    tables.motion[behind] = -2 * tables.width, -2 * tables.height
