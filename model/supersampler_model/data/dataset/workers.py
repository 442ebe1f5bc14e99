"""Render a set with several processes, a sequence at a time."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from supersampler.files import remove_partial_files
from supersampler_model.data.dataset.description import Dataset, open_dataset
from supersampler_model.data.dataset.produce import render_sequence
from supersampler_model.data.gl.renderer import Renderer
from supersampler_model.data.processes import OnFrame, run_parts


def render_dataset(
    dataset: Dataset, *, workers: int = 1, on_frame: Callable[[], None] = lambda: None
) -> None:
    """Render all frames that are not there yet.

    Args:
        dataset: what to complete.
        workers: processes; software OpenGL draws with cores / workers threads in each.
        on_frame: called after each frame, in this process.

    Raises:
        DataError: a worker failed (a full disk, no OpenGL, a file that has changed); what is complete
            stays, and a next run goes on.
    """
    remove_partial_files(dataset.folder)
    todo = [i for i, e in enumerate(dataset.description.sequences) if dataset.complete(e) < e.spec.frames]
    shares = [todo[k::workers] for k in range(min(workers, len(todo)))]
    run_parts([partial(_render, dataset.folder, share) for share in shares], on_frame=on_frame)


def _render(folder: Path, indices: list[int], on_frame: OnFrame) -> None:
    """Render some sequences in this process."""
    dataset = open_dataset(folder)
    description = dataset.description
    renderer = Renderer(description.display_size, samples=description.samples)
    for index in indices:
        render_sequence(dataset, description.sequences[index], renderer, on_frame=on_frame)
