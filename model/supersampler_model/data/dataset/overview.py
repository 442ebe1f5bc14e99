"""Overviews of a training set: class maps, a contact sheet, and the rows of `supersampler info DATASET`.

Class maps show false colours over an image, with a legend. The colours are those of Okabe and Ito, which
colour-blind readers can distinguish. Aliased pixels with visibility ghosting have a colour of their own; no
other two classes can be combined.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.aux_outputs import CLASS_COLORS
from supersampler.errors import ArgumentError
from supersampler.io.display import BT709_WEIGHTS, display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, Split, open_dataset
from supersampler_model.data.labels import Alias, Ghost, Labels

Image = NDArray[np.uint8]

OPACITY = 0.6
LUMA = np.array(BT709_WEIGHTS)

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
_SPLITS: tuple[Split, ...] = ("train", "validation", "test")
_ACROSS, _WIDTH = 6, 240  # images per row of a contact sheet, maximum width of each


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
    """Return the classes' colours over the image in grey: (H, W, 3) sRGB.

    Args:
        labels: of the frame.
        image: (H, W, 3) of that frame, tone-mapped sRGB, uint8 or float in [0, 1].

    Raises:
        ArgumentError: the image is not of the labels' size, or of another type.
    """
    shape = (*labels.ghost.shape, 3)
    if image.shape != shape or not (image.dtype == np.uint8 or np.issubdtype(image.dtype, np.floating)):
        want = f"{shape} uint8, or float in [0, 1]"
        raise ArgumentError("image", got=f"{image.shape} {image.dtype}", want=want)
    values = image.astype(np.float32) * (1.0 if image.dtype == np.uint8 else 255.0)
    tinted = np.repeat((values @ LUMA)[..., None], 3, axis=-1)
    for name, mask in masks_of(labels).items():
        tinted[mask] += OPACITY * (np.array(CLASS_COLORS[name]) - tinted[mask])
    return np.asarray(np.clip(np.rint(tinted), 0, 255), np.uint8)


def with_legend(image: Image, labels: Labels) -> Image:
    """Put a legend under an image: each colour, its class, and the fraction of pixels.

    Returns:
        (H + legend, max(W, legend), 3) sRGB; the image is in the upper left corner.
    """
    scale = 1 + image.shape[1] // 480
    lines = [_legend_line(name, float(np.mean(mask)), scale) for name, mask in masks_of(labels).items()]
    columns = max(1, min(len(lines), image.shape[1] // lines[0].shape[1]))
    lines += [np.zeros_like(lines[0])] * (-len(lines) % columns)
    rows = [np.concatenate(lines[i : i + columns], axis=1) for i in range(0, len(lines), columns)]
    legend = np.concatenate(rows)
    width = max(image.shape[1], legend.shape[1])
    return np.concatenate(
        [np.pad(part, ((0, 0), (0, width - part.shape[1]), (0, 0))) for part in (image, legend)]
    )


def _legend_line(name: str, fraction: float, scale: int) -> Image:
    """Return one entry of the legend, of fixed width: a swatch, the name, the fraction in percent."""
    text = f"{name:<{max(map(len, CLASS_COLORS))}} {100 * fraction:5.1f}%"
    letters = [[[int(row) >> bit & 1 for bit in (2, 1, 0)] for row in GLYPHS[letter]] for letter in text]
    ink = np.concatenate([np.pad(np.array(letter, bool), ((0, 0), (0, 1))) for letter in letters], axis=1)
    line = np.zeros((LINE, LINE + ink.shape[1] + ADVANCE, 3), np.uint8)
    line[1 : LINE - 1, 1 : LINE - 1] = CLASS_COLORS[name]
    line[1 : 1 + ink.shape[0], LINE : LINE + ink.shape[1]][ink] = 255
    return line.repeat(scale, axis=0).repeat(scale, axis=1)


def write_class_maps(dataset: Dataset, folder: Path) -> None:
    """Write the class map of the middle frame of each sequence that has one, with a legend."""
    for entry in dataset.entries():
        complete = dataset.complete(entry)
        if complete:
            frame = dataset.read(entry, complete // 2)
            labels = Labels(ghost=np.array(frame.ghost), alias=np.array(frame.alias))
            image = overlay(labels, to_uint8(display_transform(frame.reference, frame.exposure)))
            write_png(folder / f"{entry.spec.family}-{entry.spec.seed}.png", with_legend(image, labels))


def contact_sheet(dataset: Dataset) -> Image:
    """Return the middle frame of each sequence, row by row: (h, w, 3) sRGB."""
    images = [_thumbnail(dataset, entry) for entry in dataset.entries() if dataset.complete(entry)]
    if not images:
        return np.zeros((1, 1, 3), np.uint8)
    across = min(len(images), _ACROSS)
    images += [np.zeros_like(images[0])] * (-len(images) % across)
    rows = [np.concatenate(images[i : i + across], axis=1) for i in range(0, len(images), across)]
    return np.concatenate(rows)


def _thumbnail(dataset: Dataset, entry: SequenceEntry) -> Image:
    frame = dataset.read(entry, dataset.complete(entry) // 2)
    step = -(-frame.reference.shape[1] // _WIDTH)
    height, width = (n // step * step for n in frame.reference.shape[:2])
    blocks = np.asarray(frame.reference[:height, :width], np.float32)
    mean = blocks.reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return to_uint8(display_transform(mean, frame.exposure))


def rows(folder: Path) -> dict[str, str]:
    """Return name and text of each row, and write a contact sheet to the set's folder.

    Raises:
        DatasetError: the folder is no training set, or a frame is damaged.
    """
    dataset = open_dataset(folder)
    width, height = dataset.description.display_size
    sheet = folder / "contact-sheet.png"
    write_png(sheet, contact_sheet(dataset))
    ratios = Counter(entry.ratio for entry in dataset.entries())
    families = Counter(entry.spec.family for entry in dataset.entries())
    return {
        "training set": str(folder),
        "display size": f"{width}x{height}, {dataset.description.samples} samples a pixel",
        "sequences": "\n".join(_counts(dataset)),
        "ratios": ", ".join(f"{ratio:g} in {count}" for ratio, count in sorted(ratios.items())),
        "families": ", ".join(f"{family} {count}" for family, count in sorted(families.items())),
        "classes": "\n".join(_classes(dataset)),
        "sheet": str(sheet),
    }


def _counts(dataset: Dataset) -> Iterator[str]:
    for split in _SPLITS:
        if entries := dataset.entries(split):
            complete, total = sum(map(dataset.complete, entries)), sum(e.spec.frames for e in entries)
            yield f"{split}: {len(entries)} sequences, {complete} of {total} frames"


def _classes(dataset: Dataset) -> Iterator[str]:
    """Yield a line for each split, and one for each of its families."""
    for split in _SPLITS:
        entries = [entry for entry in dataset.entries(split) if dataset.complete(entry)]
        if entries:
            yield f"{split}: {_percentages(dataset, entries)}"
            for family in sorted({entry.spec.family for entry in entries}):
                of_family = [entry for entry in entries if entry.spec.family == family]
                yield f"  {family}: {_percentages(dataset, of_family)}"
        elif dataset.entries(split):
            yield f"{split}: nothing rendered"


def _percentages(dataset: Dataset, entries: list[SequenceEntry]) -> str:
    return ", ".join(f"{name} {fraction:.2%}" for name, fraction in class_fractions(dataset, entries).items())


def class_fractions(dataset: Dataset, entries: Sequence[SequenceEntry]) -> dict[str, float]:
    """Return the fraction of each class over the pixels of some sequences; NaN without frames.

    First frames after cuts are skipped: all of their pixels are disoccluded.
    """
    counts, pixels = dict.fromkeys(("visibility", "shading", "geometry", "texture"), 0), 0
    for frame in (frame for entry in entries for frame in dataset.frames(entry) if not frame.reset):
        pixels += frame.ghost.size
        for name, mask in zip(
            counts, (m == v for m in (frame.ghost, frame.alias) for v in (1, 2)), strict=True
        ):
            counts[name] += int(mask.sum())
    return {name: count / pixels if pixels else float("nan") for name, count in counts.items()}
