"""Overviews of a training set: class maps, a contact sheet, and the output of `supersampler info DATASET`."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.aux_outputs import CLASS_COLORS
from supersampler.errors import ArgumentError
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler_model.data.dataset.description import (
    Dataset,
    SequenceEntry,
    Split,
    class_fractions,
    open_dataset,
)
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


_ACROSS, _WIDTH = 6, 240  # images per row, maximum width of each


def write_sheet(dataset: Dataset, folder: Path) -> None:
    """Write the class map of the middle frame of each sequence that has one, with a legend."""
    for entry in dataset.entries():
        complete = dataset.complete(entry)
        if complete:
            frame = dataset.read(entry, complete // 2)
            labels = Labels(ghost=np.array(frame.ghost), alias=np.array(frame.alias))
            image = overlay(labels, _displayed(frame.reference, frame.exposure))
            name = f"{entry.spec.family}-{entry.spec.seed}.png"
            write_png(folder / name, with_legend(image, labels))


def contact_sheet(dataset: Dataset) -> Image:
    """(h, w, 3) sRGB: the middle frame of each sequence, row by row."""
    images = [_small(dataset, entry) for entry in dataset.entries() if dataset.complete(entry)]
    if not images:
        return np.zeros((1, 1, 3), np.uint8)
    height, width = images[0].shape[:2]
    rows = -(-len(images) // _ACROSS)
    sheet = np.zeros((rows * height, min(len(images), _ACROSS) * width, 3), np.uint8)
    for index, image in enumerate(images):
        y, x = index // _ACROSS * height, index % _ACROSS * width
        sheet[y : y + height, x : x + width] = image
    return sheet


def _small(dataset: Dataset, entry: SequenceEntry) -> Image:
    frame = dataset.read(entry, dataset.complete(entry) // 2)
    step = -(-frame.reference.shape[1] // _WIDTH)
    height, width = (n // step * step for n in frame.reference.shape[:2])
    blocks = np.asarray(frame.reference[:height, :width], np.float32)
    mean = blocks.reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return _displayed(mean, frame.exposure)


def _displayed(color: NDArray[Any], exposure: float) -> Image:
    return to_uint8(display_transform(color, exposure))


_SPLITS: tuple[Split, ...] = ("train", "validation", "test")


def rows(folder: Path) -> dict[str, str]:
    """Return name and text of each line, and write a contact sheet to the set's folder.

    Raises:
        DatasetError: the folder is no training set, or a frame is damaged.
    """
    dataset = open_dataset(folder)
    description = dataset.description
    width, height = description.display_size
    sheet = folder / "contact-sheet.png"
    write_png(sheet, contact_sheet(dataset))
    return {
        "training set": str(folder),
        "display size": f"{width}x{height}, {description.samples} samples a pixel",
        "sequences": _counts(dataset),
        "ratios": _ratios(dataset),
        "families": _families(dataset),
        "classes": "\n".join(_classes(dataset)),
        "sheet": str(sheet),
    }


def _counts(dataset: Dataset) -> str:
    lines = []
    for split in _SPLITS:
        entries = dataset.entries(split)
        if entries:
            there, all_of_it = sum(map(dataset.complete, entries)), sum(e.spec.frames for e in entries)
            lines.append(f"{split}: {len(entries)} sequences, {there} of {all_of_it} frames")
    return "\n".join(lines)


def _ratios(dataset: Dataset) -> str:
    counts = Counter(entry.ratio for entry in dataset.entries())
    return ", ".join(f"{ratio:g} in {count}" for ratio, count in sorted(counts.items()))


def _families(dataset: Dataset) -> str:
    counts = Counter(entry.spec.family for entry in dataset.entries())
    return ", ".join(f"{family} {count}" for family, count in sorted(counts.items()))


def _classes(dataset: Dataset) -> Iterator[str]:
    """Yield a line for each split, and one for each of its families."""
    for split in _SPLITS:
        entries = [entry for entry in dataset.entries(split) if dataset.complete(entry)]
        if not dataset.entries(split):
            continue
        if not entries:
            yield f"{split}: nothing rendered"
            continue
        yield f"{split}: {_fractions(dataset, entries)}"
        for family in sorted({entry.spec.family for entry in entries}):
            yield f"  {family}: {_fractions(dataset, [e for e in entries if e.spec.family == family])}"


def _fractions(dataset: Dataset, entries: list[SequenceEntry]) -> str:
    return ", ".join(f"{name} {fraction:.2%}" for name, fraction in class_fractions(dataset, entries).items())
