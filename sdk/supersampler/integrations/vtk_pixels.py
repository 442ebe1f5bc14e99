"""Pixels of a VTK window with OpenGL: reads colour and depth, and shows an image."""

from typing import Any

import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_UNSIGNED_CHAR, vtkFloatArray, vtkUnsignedCharArray
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLFramebufferObject, vtkTextureObject

from supersampler.frame import Float32, Size
from supersampler.integrations.rgba import encode_rgba

_READ_FRAMEBUFFER, _DRAW_FRAMEBUFFER = 0x8CA8, 0x8CA9  # OpenGL's constants
_COLOR_BUFFER_BIT, _NEAREST = 0x4000, 0x2600


class WindowPixels:
    """Reads the lower left part of a window's image, and shows another image in place of all of it.

    Args:
        window: a `vtkRenderWindow` with OpenGL, without multi-sampling.
    """

    def __init__(self, window: Any) -> None:
        self._window = window
        self._color, self._depth = vtkUnsignedCharArray(), vtkFloatArray()
        self._texture, self._buffer = vtkTextureObject(), vtkOpenGLFramebufferObject()
        self._encoded = np.empty((0, 0), np.int32)

    def read_color(self, size: Size) -> Float32:
        """Return (h, w, 3) display values in [0, 1] of the lower left (width, height) pixels."""
        width, height = size
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, self._color, 0)
        pixels = vtk_to_numpy(self._color).reshape(height, width, 3)[::-1]  # VTK's row 0 is at the bottom
        color: Float32 = np.multiply(pixels, np.float32(1.0 / 255.0), dtype=np.float32)
        return color

    def read_depth(self, size: Size) -> Float32:
        """Return (h, w) of the depth buffer: 0 at the near plane, 1 at the far plane and the background."""
        width, height = size
        self._window.GetZbufferData(0, 0, width - 1, height - 1, self._depth)
        return np.ascontiguousarray(vtk_to_numpy(self._depth).reshape(height, width)[::-1])

    def show(self, image: Float32) -> None:
        """Write an image (h, w, 3) of display values to the window's colour buffer; h and w are its size."""
        height, width = image.shape[:2]
        if self._encoded.shape != (height, width):
            self._encoded = np.empty((height, width), np.int32)
        encode_rgba(image, self._encoded)
        self._texture.SetContext(self._window)
        self._buffer.SetContext(self._window)
        state = self._window.GetState()
        state.PushFramebufferBindings()
        try:  # a copy: `SetPixelData` renders a rectangle, which takes much longer in software
            pixels = self._encoded.view(np.uint8)
            self._texture.Create2DFromRaw(width, height, 4, VTK_UNSIGNED_CHAR, pixels)
            self._buffer.Bind(_READ_FRAMEBUFFER)
            self._buffer.AddColorAttachment(0, self._texture)
            self._buffer.ActivateReadBuffer(0)
            window = self._window.GetRenderFramebuffer()
            window.Bind(_DRAW_FRAMEBUFFER)
            window.ActivateDrawBuffer(0)
            corners = (0, width, 0, height)
            vtkOpenGLFramebufferObject.Blit(corners, corners, _COLOR_BUFFER_BIT, _NEAREST)
        finally:
            state.PopFramebufferBindings()
