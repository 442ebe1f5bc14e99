"""Motion vectors of a static scene under a moving camera, for renderers that write none."""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from supersampler.arguments import as_number, checked_choice
from supersampler.conventions.jitter import checked_jitter, checked_matrix
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Array, Float32, as_array

Matrix = NDArray[np.float64]
ClipDepth = Literal["zero_to_one", "minus_one_to_one"]

_BAND_PIXELS = 16384  # of one pass: its temporaries stay in the second-level cache
_BEHIND = 1e-6  # w of the previous clip space over that of this one
_PARALLEL = 1e-5  # of the depth row to the w row of a matrix: the rounding of float32 matrices


def camera_motion(
    depth: Array,
    view_projection: ArrayLike,
    previous_view_projection: ArrayLike,
    *,
    jitter: tuple[float, float] = (0.0, 0.0),
    near: float | None = None,
    clip: ClipDepth = "zero_to_one",
) -> Float32:
    """Return `Frame.motion` of what does not move itself: where the previous camera saw each sample.

    The depth places each sample in clip space, and previous_view_projection @ inverse(view_projection) takes
    it to the previous clip space. The sky moves, too: it turns with the camera. Surfaces that move by
    themselves need motion of their own.

    Args:
        depth: (h, w), row 0 on top. Without `near`, the depth buffer's values in [0, 1], as `view_projection`
            writes them: perspective or orthographic, reversed or not. With `near`, `Frame.depth`: near / view
            distance, 0 at the sky (perspective only).
        view_projection: (4, 4) of this frame, projection @ view, without jitter; row-major, acting on column
            vectors; clip space y points up. Transpose the matrices of an engine with row vectors (Direct3D,
            Unreal); negate row 1 of a Vulkan projection whose y points down.
        previous_view_projection: the same of the frame before.
        jitter: (x right, y down) of this frame, in render pixels.
        near: the distance that `Frame.depth` is relative to, > 0.
        clip: clip space depth / w of what the depth buffer shows as 0 to 1: "zero_to_one" (Direct3D, Vulkan,
            Metal, WebGPU, OpenGL with glClipControl) or "minus_one_to_one" (OpenGL).

    Returns:
        (h, w, 2) float32: previous minus current, render pixels, x right and y down, without jitter. What was
        behind the previous camera gets a vector that leaves the image.

    Raises:
        ArgumentError: `depth` is not (h, w) of floats, a matrix is not 4 x 4, finite and invertible, `jitter`
            is not two finite numbers, `near` is not > 0 or was given with a matrix that is not perspective.
    """
    buffer = _checked_depth(depth)
    current = checked_matrix("view_projection", view_projection).astype(np.float64)
    previous = checked_matrix("previous_view_projection", previous_view_projection).astype(np.float64)
    checked_choice("clip", clip, get_args(ClipDepth))
    jitter_x, jitter_y = checked_jitter(jitter)
    to_clip, far_depth = _to_clip_space(current, near, clip)
    to_clip[2, 3] += to_clip[2, 2] * far_depth  # depth counts from there: far away none of it is rounded

    height, width = buffer.shape
    x = (np.arange(width) + 0.5 + jitter_x) * (2.0 / width) - 1.0
    y = 1.0 - (np.arange(height)[:, None] + 0.5 + jitter_y) * (2.0 / height)
    to_previous = previous @ _inverse(current) @ to_clip
    motion = np.empty((height, width, 2), np.float32)
    rows = max(1, _BAND_PIXELS // width)
    for top in range(0, height, rows):
        band = slice(top, top + rows)
        _write_motion(motion[band], buffer[band] - np.float32(far_depth), to_previous, x, y[band])
        motion[band] *= np.array([width / 2.0, -height / 2.0], np.float32)  # clip y points up, motion y down
    return motion


def _checked_depth(depth: Array) -> Float32:
    array = as_array("depth", depth, ArgumentError)
    if array.ndim != 2 or 0 in array.shape:
        raise ArgumentError("depth", got=f"of shape {array.shape}", want="(h, w), at least one pixel")
    if array.dtype.kind != "f":
        raise ArgumentError("depth", got=array.dtype, want="floats")
    return array.astype(np.float32, copy=False)


def _inverse(view_projection: Matrix) -> Matrix:
    try:
        return np.linalg.inv(view_projection).astype(np.float64, copy=False)
    except np.linalg.LinAlgError:
        got = shown(view_projection.tolist())
        raise ArgumentError("view_projection", got=got, want="an invertible matrix") from None


def _to_clip_space(matrix: Matrix, near: float | None, clip: ClipDepth) -> tuple[Matrix, float]:
    """Return the matrix from (x, y, depth, 1) to clip space / w, and the depth of the farthest, 0 or 1."""
    # In a perspective, z / w = far + slope / w: the rows of z and w have parallel directions.
    z, w = matrix[2], matrix[3]
    squared = float(w[:3] @ w[:3])
    far = float(z[:3] @ w[:3]) / squared if squared > 0.0 else 0.0
    to_clip: Matrix = np.eye(4)
    if near is None:
        if clip == "minus_one_to_one":
            to_clip[2, 2:] = 2.0, -1.0
        return to_clip, float(np.rint(np.clip((far - to_clip[2, 3]) / to_clip[2, 2], 0.0, 1.0)))
    distance = as_number(near)
    if distance is None or not 0.0 < distance < np.inf:
        raise ArgumentError("near", got=shown(near), want="a distance > 0")
    if squared == 0.0 or np.abs(z[:3] - far * w[:3]).max() > _PARALLEL * np.sqrt(squared):
        want = "None, as the projection is orthographic or has an oblique near plane"
        hint = "Hand in the depth buffer's own values."
        raise ArgumentError("near", got=shown(near), want=want, hint=hint)
    to_clip[2, 2:] = (z[3] - far * w[3]) / distance, far
    return to_clip, 0.0


def _write_motion(motion: Float32, depth: Float32, m: Matrix, x: Matrix, y: Matrix) -> None:
    """Write previous minus current of some rows in clip units; x is (width,), y (rows, 1) in clip space.

    With (X, Y, Z, W) = m @ (x, y, depth, 1), the motion is X / W - x = (X - x W) / W. Where the camera hardly
    moves, X / W and x are nearly equal and their difference in single precision is noise; X - x W has its
    differences in the coefficients, which are of double precision.
    """
    of_depth_x, of_y = m[0, 2] - m[3, 2] * x, m[0, 1] - m[3, 1] * x
    of_depth_y, of_x = m[1, 2] - m[3, 2] * y, m[1, 0] - m[3, 0] * y
    rest_x = (m[0, 0] - m[3, 3] - m[3, 0] * x) * x + m[0, 3]
    rest_y = (m[1, 1] - m[3, 3] - m[3, 1] * y) * y + m[1, 3]
    x32, y32 = x.astype(np.float32), y.astype(np.float32)
    w = _linear(depth, m[3, 2], m[3, 0], x32, m[3, 1] * y + m[3, 3])
    behind = w < _BEHIND
    w[behind] = 1.0
    np.divide(_linear(depth, of_depth_x, of_y, y32, rest_x), w, out=motion[..., 0])
    np.divide(_linear(depth, of_depth_y, of_x, x32, rest_y), w, out=motion[..., 1])
    motion[behind] = -4.0, 4.0  # two images to the left and above


def _linear(depth: Float32, factor: Any, slope: Any, position: Float32, rest: Any) -> Float32:
    """Return factor * depth + slope * position + rest, broadcast, in single precision."""
    image: Float32 = np.float32(slope) * position + np.float32(rest)
    image += np.float32(factor) * depth
    return image
