"""Render targets: textures to render into and read back."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.renderer.context import Graphics

Size = tuple[int, int]


class Target:
    """A framebuffer of some colour textures, with 32-bit float depth if asked for."""

    def __init__(
        self, graphics: Graphics, size: Size, formats: tuple[tuple[int, str], ...], *, depth: bool
    ) -> None:
        """Args: formats: channels and moderngl type ("f2", "f4") of each texture."""
        gl = graphics.gl
        self.size = size
        self.textures = [gl.texture(size, channels, dtype=dtype) for channels, dtype in formats]
        for texture in self.textures:
            texture.filter = (gl.NEAREST, gl.NEAREST)
        self.framebuffer = gl.framebuffer(self.textures, graphics.depth_texture(size) if depth else None)

    def read(self, index: int) -> NDArray[Any]:
        """Return texture `index` as (h, w, channels), row 0 on top."""
        texture = self.textures[index]
        width, height = self.size
        pixels = np.frombuffer(texture.read(), texture.dtype)
        return pixels.reshape(height, width, texture.components)


class ShadowMap:
    """A depth texture that is compared when it is read: standard depth, 0 at the light."""

    def __init__(self, graphics: Graphics, size: int) -> None:
        self.texture = graphics.depth_texture((size, size))
        self.texture.compare_func = "<="
        self.texture.filter = (graphics.gl.LINEAR, graphics.gl.LINEAR)
        self.texture.repeat_x = self.texture.repeat_y = False
        self.framebuffer = graphics.gl.framebuffer((), self.texture)
