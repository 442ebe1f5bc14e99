"""Render a set with several processes, a sequence at a time."""

import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from supersampler.io.files import remove_partial_files
from supersampler_model.data.dataset.description import Dataset, open_dataset
from supersampler_model.data.dataset.produce import render_sequence
from supersampler_model.data.processes import OnFrame, run_parts
from supersampler_model.data.renderer.renderer import Renderer

_FRAMES = re.compile(r"\d{4,}(\.[\d.e+]+x)?\.safetensors")


def render_dataset(
    dataset: Dataset,
    *,
    ratio: float | None = None,
    workers: int = 1,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render all missing frames.

    Args:
        dataset: the data set.
        ratio: of a second rendering of all sequences; None: the set itself.
        workers: processes; software OpenGL uses cores / workers threads in each.
        on_frame: called after each frame, in this process.

    Raises:
        DataError: a worker failed (a full disk, no OpenGL, a file that has changed); complete
            frames stay, and the next run resumes.
    """
    folders = [entry.folder for entry in dataset.entries()]
    remove_partial_files(dataset.folder, _FRAMES.fullmatch, folders)
    at = dataset if ratio is None else dataset.at(ratio)
    todo = [index for index, entry in enumerate(at.entries()) if at.complete(entry) < entry.spec.frames]
    indices = [todo[k::workers] for k in range(min(workers, len(todo)))]
    run_parts([partial(_render, dataset.folder, ratio, part) for part in indices], on_frame=on_frame)


def _render(folder: Path, ratio: float | None, indices: Sequence[int], on_frame: OnFrame) -> None:
    """Render some sequences in this process."""
    dataset = open_dataset(folder)
    dataset = dataset if ratio is None else dataset.at(ratio)
    description = dataset.description
    renderer = Renderer(description.display_size, samples=description.samples)
    for index in indices:
        render_sequence(dataset, description.sequences[index], renderer, on_frame=on_frame)
