"""Sizes of memory and of passes as rules on the sizes of frame and image."""

from typing import Literal, NamedTuple

from supersampler.backends.gpu.memory import BufferSpec, MemorySpec, TextureSpec
from supersampler.frame import Size
from supersampler.methods.at_rest import BLOCK, PHASES_PER_SAMPLE, SPARE_PHASES, block_count, phase_count
from supersampler.methods.sizes import large_size

Base = Literal["one", "render", "previous", "display", "large", "signatures", "previous_signatures"]
MOST_PHASES = PHASES_PER_SAMPLE * 4 * 4 + SPARE_PHASES
"""Phases of the largest ratio."""


class Extent(NamedTuple):
    """A size in pixels: `of` / `divide`, rounded up, times `multiply`.

    Attributes:
        of: "render" and "previous", sizes of this frame and of the one before; "display", of the image;
            "large", 1.4 times the display (`large_size`); "one", which is (1, 1); "signatures" and
            "previous_signatures", the blocks of that frame, one phase of the jitter below the other.
        divide: of both axes.
        multiply: of each axis, (x, y).
    """

    of: Base
    divide: int = 1
    multiply: Size = (1, 1)

    def size(self, render: Size, display: Size, previous: Size | None = None) -> Size:
        """Return (width, height) at these sizes; `previous` is as `render` if not given."""
        width, height = _size_of(self.of, render, display, previous or render)
        return -(-width // self.divide) * self.multiply[0], -(-height // self.divide) * self.multiply[1]

    @property
    def enlarged(self) -> "Extent":
        """The same rule on the larger display; itself where it is not of the display."""
        return self._replace(of="large") if self.of == "display" else self


def _size_of(base: Base, render: Size, display: Size, previous: Size) -> Size:
    if base == "large":
        return large_size(display)
    if base.endswith("signatures"):
        frame = render if base == "signatures" else previous
        across, down = block_count(frame)
        return across, down * phase_count(display, frame)
    return {"one": (1, 1), "render": render, "display": display}.get(base, previous)


ONE, RENDER, PREVIOUS, DISPLAY = Extent("one"), Extent("render"), Extent("previous"), Extent("display")
HALF, LARGE, LARGE_HALF = Extent("display", 2), Extent("large"), Extent("large", 2)
BLOCKS, PHASES = Extent("render", BLOCK), Extent("one", multiply=(MOST_PHASES, 1))


class PixelBuffer(NamedTuple):
    """A storage buffer of `bytes` for each pixel of an extent."""

    bytes: int
    extent: Extent = ONE

    def spec(self, render: Size, display: Size, previous: Size | None = None) -> MemorySpec:
        """Return the memory at these sizes; see `Extent.size`."""
        width, height = self.extent.size(render, display, previous)
        return BufferSpec(self.bytes * width * height)


class PixelTexture(NamedTuple):
    """A texture of an extent, of a format in TEXELS."""

    extent: Extent
    format: str = "rgba32float"

    def spec(self, render: Size, display: Size, previous: Size | None = None) -> MemorySpec:
        """Return the memory at these sizes; see `Extent.size`."""
        return TextureSpec(self.extent.size(render, display, previous), self.format)


PixelMemory = PixelBuffer | PixelTexture
