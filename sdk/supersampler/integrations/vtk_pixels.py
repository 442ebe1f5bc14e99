"""Reads the pixels of a VTK render window, and writes others."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_UNSIGNED_CHAR, vtkFloatArray, vtkUnsignedCharArray
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLFramebufferObject, vtkTextureObject

from supersampler.backends.cpu.library import encode_rgba
from supersampler.frame import Float32, Size

Float64 = NDArray[np.float64]
_READ_FRAMEBUFFER, _DRAW_FRAMEBUFFER = 0x8CA8, 0x8CA9  # OpenGL's constants
_COLOR_BUFFER_BIT, _NEAREST, _SCISSOR_TEST = 0x4000, 0x2600, 0x0C11
_MAX_STEP = 0.02  # of the depth buffer between neighbouring samples of one surface
_OFFSET = 2e-6  # of the depth buffer, so that a line on a surface is in front of it


class Rectangle(NamedTuple):
    """Pixels of a window; (left, bottom) is the lower left one."""

    left: int
    bottom: int
    width: int
    height: int

    @property
    def last(self) -> tuple[int, int, int, int]:
        """Left, bottom, and the last column and row, as VTK wants them."""
        return self.left, self.bottom, self.left + self.width - 1, self.bottom + self.height - 1

    def overlaps(self, other: "Rectangle") -> bool:
        """Return whether two rectangles have pixels in common."""
        return (max(self.left, other.left) < min(self.left + self.width, other.left + other.width)) and (
            max(self.bottom, other.bottom) < min(self.bottom + self.height, other.bottom + other.height)
        )


class WindowPixels:
    """Reads and writes parts of a window's image and depth buffer. Row 0 of arrays is on top.

    Args:
        window: a `vtkRenderWindow` with OpenGL.
    """

    def __init__(self, window: Any) -> None:
        self._window = window
        self._color, self._depth = vtkUnsignedCharArray(), vtkFloatArray()
        self._texture, self._buffer = vtkTextureObject(), vtkOpenGLFramebufferObject()

    def read_color(self, part: Rectangle) -> NDArray[np.uint8]:
        """Return (h, w, 4), RGBA, valid until the next call."""
        self._window.GetRGBACharPixelData(*part.last, 0, self._color, 0)
        pixels: NDArray[np.uint8] = vtk_to_numpy(self._color).reshape(part.height, part.width, 4)[::-1]
        return pixels

    def read_depth(self, part: Rectangle) -> Float32:
        """Return (h, w) of the depth buffer: 0 at the near plane, 1 at the far plane and the background."""
        self._window.GetZbufferData(*part.last, self._depth)
        return np.ascontiguousarray(vtk_to_numpy(self._depth).reshape(part.height, part.width)[::-1])

    def write_depth(self, depth: Float32, part: Rectangle) -> None:
        """Write (h, w) to the depth buffer."""
        self._depth.SetNumberOfValues(depth.size)
        vtk_to_numpy(self._depth).reshape(depth.shape)[:] = depth[::-1]
        self._window.GetState().vtkglDepthMask(True)  # translucent surfaces leave it off
        self._window.SetZbufferData(*part.last, self._depth)

    def write_color(self, image: Float32, alpha: NDArray[np.uint8], part: Rectangle) -> None:
        """Write (h, w, 3) display values, and alpha (h, w)."""
        encoded = np.empty((part.height, part.width), np.int32)
        encode_rgba(image, encoded)
        encoded.view(np.uint8)[:, 3::4] = alpha[::-1]
        self._texture.SetContext(self._window)
        self._buffer.SetContext(self._window)
        state = self._window.GetState()
        state.PushFramebufferBindings()
        try:  # a copy: `SetPixelData` renders a rectangle, which is much slower in software
            state.vtkglDisable(_SCISSOR_TEST)  # it limits copies, too
            pixels = encoded.view(np.uint8)
            self._texture.Create2DFromRaw(part.width, part.height, 4, VTK_UNSIGNED_CHAR, pixels)
            self._buffer.Bind(_READ_FRAMEBUFFER)
            self._buffer.AddColorAttachment(0, self._texture)
            self._buffer.ActivateReadBuffer(0)
            window = self._window.GetRenderFramebuffer()
            window.Bind(_DRAW_FRAMEBUFFER)
            window.ActivateDrawBuffer(0)
            left, bottom, width, height = part
            source, target = (0, width, 0, height), (left, left + width, bottom, bottom + height)
            vtkOpenGLFramebufferObject.Blit(source, target, _COLOR_BUFFER_BIT, _NEAREST)
        finally:
            state.PopFramebufferBindings()


def nearest_samples(image: NDArray[Any], size: Size, jitter: tuple[float, float]) -> NDArray[Any]:
    """Return the nearest sample of a jittered image (h, w) at each pixel of a larger one.

    `size`: (width, height) of the larger image. `jitter`: see `Frame`.
    """
    rows, columns = (
        np.clip(np.rint(_places(axis, image.shape, size, jitter)), 0, image.shape[axis] - 1).astype(np.intp)
        for axis in (0, 1)
    )
    return image.take(rows, 0).take(columns, 1)


def _places(axis: int, shape: tuple[int, ...], size: Size, jitter: tuple[float, float]) -> Float64:
    """Return where the pixels of a larger image are among jittered samples, along an axis."""
    count, length = size[1 - axis], shape[axis]
    return np.asarray((np.arange(count) + 0.5) * (length / count) - 0.5 - jitter[1 - axis])


def upsampled_depth(buffer: Float32, size: Size, jitter: tuple[float, float]) -> Float32:
    """Return a jittered depth buffer at the pixel centres of a larger image.

    The depth buffer is linear on a plane, so that interpolated values are exact there. Values are moved back
    by half of the local step, in favour of lines on surfaces. Across outlines the surface of the nearest
    sample counts, at its farthest in the 3x3 samples around that one: lines along outlines have no gaps.

    Args:
        buffer: (h, w) depth buffer.
        size: (width, height) of the larger image.
        jitter: see `Frame`.

    Returns:
        (height, width) depth buffer.
    """
    low = high = mean = buffer
    nearest = _farthest_around(buffer)
    for axis in (0, 1):
        length = buffer.shape[axis]
        place = np.clip(_places(axis, buffer.shape, size, jitter), 0.0, length - 1.0)
        before = place.astype(np.intp)
        after = np.minimum(before + 1, length - 1)
        weight = np.expand_dims((place - before).astype(np.float32), 1 - axis)
        low = np.minimum(low.take(before, axis), low.take(after, axis))
        high = np.maximum(high.take(before, axis), high.take(after, axis))
        first = mean.take(before, axis)
        mean = first + weight * (mean.take(after, axis) - first)
        nearest = nearest.take(np.rint(place).astype(np.intp), axis)
    step = high - low
    mean += np.float32(0.5) * step + np.float32(_OFFSET)
    np.copyto(mean, nearest, where=(step > _MAX_STEP) | (high == 1.0))
    return mean


def _farthest_around(buffer: Float32) -> Float32:
    """Return the farthest depth in the 3x3 samples around each sample, on its surface, (h, w)."""
    height, width = buffer.shape
    limit = np.minimum(buffer + np.float32(_MAX_STEP), np.nextafter(np.float32(1.0), np.float32(0.0)))
    around = np.pad(buffer, 1, mode="edge")
    farthest = buffer.copy()
    for y in range(3):
        for x in range(3):
            depth = around[y : y + height, x : x + width]
            np.maximum(farthest, np.where(depth <= limit, depth, np.float32(0.0)), out=farthest)
    return farthest
