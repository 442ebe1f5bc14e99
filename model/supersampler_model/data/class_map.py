"""Class maps of the labels: false colours over an image, with a legend.

The colours are those of Okabe and Ito, which colour-blind readers can distinguish. Aliased pixels with
visibility ghosting have a colour of their own; no other two classes can be combined.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.aux_outputs import CLASS_COLORS
from supersampler.errors import ArgumentError
from supersampler_model.data.labels import Alias, Ghost, Labels

Image = NDArray[np.uint8]

OPACITY = 0.6
LUMA = np.array((0.2126, 0.7152, 0.0722))

# Letters of 3 x 5 pixels: five octal digits each, rows from the top; the leftmost pixel is the highest bit.
GLYPHS = {
    "a": "25755", "b": "65656", "c": "34443", "d": "65556", "e": "74647", "f": "74644", "g": "34553",
    "h": "55755", "i": "72227", "j": "11152", "k": "55655", "l": "44447", "m": "57755", "n": "65555",
    "o": "25552", "p": "65644", "q": "25563", "r": "65655", "s": "34216", "t": "72222", "u": "55557",
    "v": "55552", "w": "55775", "x": "55255", "y": "55222", "z": "71247", "0": "75557", "1": "26227",
    "2": "61247", "3": "61216", "4": "55711", "5": "74616", "6": "34752", "7": "71222", "8": "25252",
    "9": "25716", ".": "00002", ",": "00024", "%": "51245", " ": "00000",
}  # fmt: skip
ADVANCE, LINE = 4, 8  # pixels from letter to letter, and from line to line, before scaling


def masks_of(labels: Labels) -> dict[str, NDArray[np.bool_]]:
    """Return which pixels (H, W) have each colour of CLASS_COLORS; no two overlap."""
    visibility, shading = labels.ghost == Ghost.VISIBILITY, labels.ghost == Ghost.SHADING
    aliased, ghost = labels.alias != Alias.NONE, labels.ghost != Ghost.NONE
    return {
        "visibility": visibility & ~aliased,
        "visibility, aliased": visibility & aliased,
        "shading": shading,
        "geometry": (labels.alias == Alias.GEOMETRY) & ~ghost,
        "texture": (labels.alias == Alias.TEXTURE) & ~ghost,
    }


def overlay(labels: Labels, image: NDArray[Any]) -> Image:
    """(H, W, 3) sRGB: the classes' colours over the image in grey.

    Args:
        labels: of the frame.
        image: (H, W, 3) of that frame, tone-mapped sRGB, uint8 or float in [0, 1].

    Raises:
        ArgumentError: the image is not of the labels' size, or of another type.
    """
    want = (*labels.ghost.shape, 3)
    if image.shape != want or not (image.dtype == np.uint8 or np.issubdtype(image.dtype, np.floating)):
        raise ArgumentError(
            "image", got=f"{image.shape} {image.dtype}", want=f"{want} uint8, or float in [0, 1]"
        )
    values = image.astype(np.float32) * (1.0 if image.dtype == np.uint8 else 255.0)
    shown = np.repeat((values @ LUMA)[..., None], 3, axis=-1)
    for name, mask in masks_of(labels).items():
        shown[mask] += OPACITY * (np.array(CLASS_COLORS[name]) - shown[mask])
    return np.asarray(np.clip(np.rint(shown), 0, 255), np.uint8)


def with_legend(image: Image, labels: Labels) -> Image:
    """Put a legend under an image: each colour, its class, and the fraction of pixels.

    Returns:
        (H + legend, max(W, legend), 3) sRGB; the image is in the upper left corner.
    """
    scale = 1 + image.shape[1] // 480
    lines = [_line(name, float(np.mean(mask)), scale) for name, mask in masks_of(labels).items()]
    columns = max(1, min(len(lines), image.shape[1] // lines[0].shape[1]))
    lines += [np.zeros_like(lines[0])] * (-len(lines) % columns)
    rows = [np.concatenate(lines[i : i + columns], axis=1) for i in range(0, len(lines), columns)]
    legend = np.concatenate(rows)
    width = max(image.shape[1], legend.shape[1])
    parts = [np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0))) for part in (image, legend)]
    return np.concatenate(parts)


def _line(name: str, fraction: float, scale: int) -> Image:
    """One entry of the legend, of fixed width: a swatch, the name, the fraction in percent."""
    written = _written(f"{name:<{max(map(len, CLASS_COLORS))}} {100 * fraction:5.1f}%")
    line = np.zeros((LINE, LINE + written.shape[1] + ADVANCE, 3), np.uint8)
    line[1 : LINE - 1, 1 : LINE - 1] = CLASS_COLORS[name]
    line[1 : 1 + written.shape[0], LINE : LINE + written.shape[1]][written] = 255
    return line.repeat(scale, axis=0).repeat(scale, axis=1)


def _written(text: str) -> NDArray[np.bool_]:
    """(5, ADVANCE * letters), True where ink is."""
    letters = [[[int(row) >> bit & 1 for bit in (2, 1, 0)] for row in GLYPHS[letter]] for letter in text]
    return np.concatenate([np.pad(np.array(letter, bool), ((0, 0), (0, 1))) for letter in letters], axis=1)
