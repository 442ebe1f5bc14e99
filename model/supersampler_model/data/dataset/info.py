"""The output of `supersampler info DATASET`."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from supersampler.io.images import write_png
from supersampler_model.data.dataset.description import (
    Dataset,
    SequenceEntry,
    Split,
    class_fractions,
    open_dataset,
)
from supersampler_model.data.dataset.sheet import contact_sheet

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
