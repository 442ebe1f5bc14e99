"""Limits on what a file may declare, checked before memory is allocated. docs/security.md lists them."""

from typing import Final

IMAGE_SIDE: Final = 1 << 15
"""Pixels, of the width and of the height."""
IMAGE_PIXELS: Final = 1 << 27
"""Width times height: 16384 x 8192."""
IMAGE_PARTS: Final = 1024
IMAGE_CHANNELS: Final = 4096
"""Of all parts of an image file."""
IMAGE_BYTES: Final = 1 << 33
"""Of the pixels of an image file that are decoded at once."""
JSON_BYTES: Final = 1 << 26
"""Of a file, or of the header of another format."""
RATES: Final = (0.001, 1000.0)
"""Frames a second, of a video and of a file's header."""
SHOT_FRAMES: Final = 1 << 20


def image_size_problem(width: int, height: int) -> str | None:
    """Return the problem with an image size that a file declares; None where there is none."""
    if not (1 <= width <= IMAGE_SIDE and 1 <= height <= IMAGE_SIDE and width * height <= IMAGE_PIXELS):
        return f"is {width}x{height}; want 1 to {IMAGE_SIDE} a side and at most {IMAGE_PIXELS} pixels"
    return None
